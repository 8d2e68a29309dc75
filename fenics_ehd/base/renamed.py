"""Former public Python names, accepted for one version with a `DeprecationWarning`.

Three kinds of names are covered::

    @renamed_attributes(lift="minus_gravity")  # former attribute or method of a class
    @renamed_arguments(lift="minus_gravity")  # former keyword argument of its constructor
    @dataclass(frozen=True)
    class Body:
        minus_gravity: float


    @renamed_arguments(place="binding")  # former keyword argument of a function
    def bind(binding: Binding) -> None: ...

A former name of the package itself (``ehd.Course``) is an entry in the table of
`fenics_ehd.base.lazy.lazily`. Every renamed name has a row in ``docs/renamed.md``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Container, Mapping
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

#: Version without the former names.
REMOVED_IN = "0.5"

Cls = TypeVar("Cls", bound=type)
Renamed = TypeVar("Renamed", bound=Callable[..., Any])


def renamed_message(former: str, name: str) -> str:
    """Text of the warning about a former name."""
    return f"{former} is now {name}: the former name will be removed in {REMOVED_IN}"


def warn_renamed(former: str, name: str, depth: int = 1) -> None:
    """Warn that a former name was used.

    Parameters
    ----------
    former, name
        Former name and new name.
    depth
        Number of calls between the line that uses the former name and the caller of this function.
    """
    warnings.warn(renamed_message(former, name), DeprecationWarning, stacklevel=depth + 2)


def joint_of_bare_name(
    name: str, quantities: Mapping[str, Container[str]], depth: int = 1, before: str = ""
) -> str | None:
    """Find the joint of a quantity that is named without its joint, as in versions before 0.4.

    Parameters
    ----------
    name
        Name of the quantity without a joint, ``max_pressure_Pa``.
    quantities
        Names of the quantities of every joint.
    depth
        See `warn_renamed`.
    before
        Text before the joint in the new name, such as ``joints.`` in the summary.

    Returns
    -------
    str or None
        Name of the joint, after a warning, if only one joint has this quantity; else None.
    """
    fitting = [joint for joint, names in quantities.items() if name in names]
    if len(fitting) != 1:
        return None
    warn_renamed(name, f"{before}{fitting[0]}.{name}", depth + 1)
    return fitting[0]


class _FormerAttribute:
    """Descriptor that redirects a former attribute to the attribute with the new name.

    Attributes
    ----------
    former, name
        Former name and new name.
    """

    def __init__(self, former: str, name: str) -> None:
        self.former = former
        self.name = name

    def _warn(self, owner: type) -> None:
        """Warn that the former name was used."""
        warn_renamed(f"{owner.__name__}.{self.former}", f"{owner.__name__}.{self.name}", depth=2)

    def __get__(self, instance: Any, owner: type) -> Any:
        """Read the attribute under its new name, from an instance or from the class."""
        self._warn(owner)
        value: Any = owner if instance is None else instance
        for part in self.name.replace("[", ".").replace("]", "").split("."):
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        return value

    def __set__(self, instance: Any, value: Any) -> None:
        """Set the attribute under its new name."""
        self._warn(type(instance))
        setattr(instance, self.name, value)


def renamed_attributes(**names: str) -> Callable[[Cls], Cls]:
    """Decorate a class so that it accepts former names of its attributes and methods.

    The decorator must be above ``@dataclass``, which would read former names as defaults of fields.

    Parameters
    ----------
    names
        New name of every former name, or a path to its value: ``"surfaces[0].body"``.
    """

    def decorate(cls: Cls) -> Cls:
        for former, name in names.items():
            setattr(cls, former, _FormerAttribute(former, name))
        return cls

    return decorate


def accept_former_parameter(cls: type, method: str, former: str, name: str) -> None:
    """Accept a class whose method has the former name of a keyword parameter, with a warning.

    Base classes call this function in ``__init_subclass__``. The package calls the methods of
    derived classes with the new name of the parameter. A method with the new name is not changed.

    Parameters
    ----------
    cls, method
        The class, and the name of the method.
    former, name
        Former and new name of the parameter.
    """
    function = cls.__dict__.get(method)
    if function is None or former not in signature(function).parameters:
        return
    label = f"{cls.__name__}.{method}"
    warn_renamed(f"{label}({former}=)", f"{label}({name}=)", depth=3)

    @wraps(function)
    def called_by_present_name(*arguments: Any, **keywords: Any) -> Any:
        if name in keywords:
            keywords[former] = keywords.pop(name)
        return function(*arguments, **keywords)

    setattr(cls, method, called_by_present_name)


def renamed_arguments(**names: str) -> Callable[[Renamed], Renamed]:
    """Decorate a function or a class so that it accepts former names of keyword arguments.

    Every call passes through one more function: the decorator is not meant for functions that are
    called in every iteration of a step. The decorated function raises TypeError if it is called
    with both a former name and its new name.

    Parameters
    ----------
    names
        New name of every former name.
    """

    def accept_former(function: Callable[..., Any], label: str) -> Callable[..., Any]:
        @wraps(function)
        def accepting(*arguments: Any, **keywords: Any) -> Any:
            for former in names.keys() & keywords:
                if names[former] in keywords:
                    raise TypeError(f"{label}() got {names[former]} and its former name {former}")
                warn_renamed(f"{label}({former}=)", f"{label}({names[former]}=)")
                keywords[names[former]] = keywords.pop(former)
            return function(*arguments, **keywords)

        return accepting

    def decorate(function: Renamed) -> Renamed:
        if isinstance(function, type):
            initialise = accept_former(getattr(function, "__init__"), function.__name__)  # noqa: B009
            setattr(function, "__init__", initialise)  # noqa: B010  (mypy refuses the assignment)
            return function
        return accept_former(function, function.__name__)  # type: ignore[return-value]

    return decorate
