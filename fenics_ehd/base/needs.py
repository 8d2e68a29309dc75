"""Settings that have an effect only with another one.

A field, or an option of a command, declares what it needs, and one place refuses what is given
without it. The default is accepted everywhere: scene files list it with its meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from fenics_ehd.base.errors import SettingsError

#: Values of a text and of a temperature [C] that are not given: the latter is absolute zero.
NONE = "none"
NO_TEMPERATURE = -273.15


def is_given(value: Any) -> bool:
    """True of a value that is not zero, false, empty, `NONE` or `NO_TEMPERATURE`."""
    if isinstance(value, (list, tuple)):
        return any(map(is_given, value))
    return bool(value) and value not in (NONE, NO_TEMPERATURE)


class Setting(NamedTuple):
    """Full key and value of a setting."""

    key: str
    value: Any


#: Function that returns the setting of a key, None if there is no such key.
LookUp = Callable[[str], Setting | None]


@dataclass(frozen=True)
class Needs:
    """Condition under which a setting has an effect.

    Attributes
    ----------
    keys
        Other settings, of the same table or of a table around it; one of them must be given. Those
        that are not known where the setting is used do not count, and without any the condition
        holds.
    among
        Values of which a key must have one; empty: any that is given.
    absent
        Whether none of the keys may be given, in place of that.
    words
        Behind "without" or "with" in messages, where keys are properties of several settings.
    notice
        Whether the setting is named in a notice and not refused: shipped scenes list it together
        with the switch that leaves it without effect.
    """

    keys: tuple[str, ...]
    among: tuple[Any, ...] = ()
    absent: bool = False
    words: str = ""
    notice: bool = False

    def failure(self, look_up: LookUp) -> str:
        """Why the setting has no effect, "without ..." or "with ..."; empty if it has one."""
        known = [setting for setting in map(look_up, self.keys) if setting is not None]
        met = [setting for setting in known if self._holds(setting.value)]
        if self.absent and met:
            return f"with {self.words or f'{met[0].key} = {shown(met[0].value)}'}"
        if self.absent or met or not known:
            return ""
        wanted = " or ".join(self._wanted(setting.key) for setting in known)
        return f"without {self.words or wanted}"

    def _holds(self, value: Any) -> bool:
        return value in self.among if self.among else is_given(value)

    def _wanted(self, key: str) -> str:
        return f"{key} = {' or '.join(map(shown, self.among))}" if self.among else key


def only_with(field: Any, *keys: str, **condition: Any) -> Any:
    """A field of a settings class that has an effect only with one of the keys, see `Needs`."""
    return _with(field, Needs(keys, **condition))


def not_with(field: Any, *keys: str, **condition: Any) -> Any:
    """A field of a settings class that has no effect with any of the keys, see `Needs`."""
    return _with(field, Needs(keys, absent=True, **condition))


def _with(field: Any, condition: Needs) -> Any:
    former = field.metadata.get("needs", ())
    field.metadata = {**field.metadata, "needs": (*former, condition)}
    return field


def missing_need(conditions: Iterable[Needs], look_up: LookUp) -> str:
    """The first condition that fails, in words; empty if all hold."""
    failures = (condition.failure(look_up) for condition in conditions)
    return next(filter(None, failures), "")


def no_effect(name: str, value: Any, why: str) -> SettingsError:
    """Error that refuses a setting without effect, `why` being "without ..." or "with ..."."""
    last = name.rpartition(".")[2]
    remedy = f"give that, or drop {last}" if why.startswith("without") else f"drop {last} or that"
    plain = isinstance(value, (bool, int, float, str, tuple)) and not name.startswith("-")
    setting = f"{name} = {shown(value)}" if plain else name
    return SettingsError(f"{setting} has no effect {why}: {remedy}")


def shown(value: Any) -> str:
    """A value as scene files have it, in a message."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(shown, value))}]"
    return f"{value:g}" if isinstance(value, float) else repr(value)
