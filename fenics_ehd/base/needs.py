"""Conditions of settings that have an effect only together with, or without, another setting.

The field of a setting, or an option of a command, declares its conditions once. If a condition
fails, the setting is refused. Defaults are accepted, because complete scene files list them all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from fenics_ehd.base.errors import SettingsError
from fenics_ehd.base.printed import shown

#: Value of a text setting that is not set.
NONE = "none"

#: Value of a temperature that is not set [C]: absolute zero.
NO_TEMPERATURE = -273.15


def is_given(value: Any) -> bool:
    """Whether a value counts as set: it is not zero, false, empty, `NONE` or `NO_TEMPERATURE`."""
    if isinstance(value, (list, tuple)):
        return any(map(is_given, value))
    return bool(value) and value not in (NONE, NO_TEMPERATURE)


class Setting(NamedTuple):
    """Full key and value of a setting."""

    key: str
    value: Any


#: Function from a key to its setting, or to None for an unknown key.
LookUp = Callable[[str], Setting | None]


@dataclass(frozen=True)
class Needs:
    """Condition under which a setting has an effect.

    Attributes
    ----------
    keys
        Keys of other settings, in the same table or in an enclosing table, see `absent`.
        Unknown keys are ignored; the condition holds if all keys are unknown.
    among
        Values of these settings that count as set; if empty, all for which `is_given` is true.
    absent
        True if none of the keys may be set; false if at least one of them must be set.
    words
        Text behind "without" or "with" in messages, in place of the keys.
    notice
        Whether a setting whose condition fails is only reported in a notice, not refused. Shipped
        scenes contain such settings together with a switch that makes them ineffective.
    """

    keys: tuple[str, ...]
    among: tuple[Any, ...] = ()
    absent: bool = False
    words: str = ""
    notice: bool = False

    def failure(self, look_up: LookUp) -> str:
        """Why the setting has no effect, "without ..." or "with ..."; empty if it has an effect."""
        known = [setting for setting in map(look_up, self.keys) if setting is not None]
        met = [setting for setting in known if self._holds(setting.value)]
        if self.absent and met:
            return f"with {self.words or f'{met[0].key} = {shown(met[0].value)}'}"
        if self.absent or met or not known:
            return ""
        wanted = " or ".join(self._wanted(setting.key) for setting in known)
        return f"without {self.words or wanted}"

    def _holds(self, value: Any) -> bool:
        """Whether the value of a key counts as set."""
        return value in self.among if self.among else is_given(value)

    def _wanted(self, key: str) -> str:
        """Key with the values that count as set, for messages."""
        return f"{key} = {' or '.join(map(shown, self.among))}" if self.among else key


def only_with(field: Any, *keys: str, **condition: Any) -> Any:
    """Add to a field the condition that one of the keys is set, see `Needs`."""
    return _with(field, Needs(keys, **condition))


def not_with(field: Any, *keys: str, **condition: Any) -> Any:
    """Add to a field the condition that none of the keys is set, see `Needs`."""
    return _with(field, Needs(keys, absent=True, **condition))


def _with(field: Any, condition: Needs) -> Any:
    """Add a condition to the metadata of a field."""
    former = field.metadata.get("needs", ())
    field.metadata = {**field.metadata, "needs": (*former, condition)}
    return field


def missing_need(conditions: Iterable[Needs], look_up: LookUp) -> str:
    """Text of the first condition that fails, see `Needs.failure`; empty if all conditions hold."""
    failures = (condition.failure(look_up) for condition in conditions)
    return next(filter(None, failures), "")


class NoEffectError(SettingsError):
    """A setting has no effect.

    Attributes
    ----------
    key
        Full key of the setting, or the name of an option.
    """

    def __init__(self, message: str, key: str = ""):
        super().__init__(message)
        self.key = key


def no_effect(name: str, value: Any, why: str) -> NoEffectError:
    """Make the error about a setting without effect; `why` is "without ..." or "with ..."."""
    last = name.rpartition(".")[2]
    remedy = f"give that, or drop {last}" if why.startswith("without") else f"drop {last} or that"
    plain = isinstance(value, (bool, int, float, str, tuple)) and not name.startswith("-")
    setting = f"{name} = {shown(value)}" if plain else name
    return NoEffectError(f"{setting} has no effect {why}: {remedy}", name)
