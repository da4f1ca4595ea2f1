"""One number that a user can set: its range, its parser, and the error for a value outside."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.errors import UsageError
from gcs_autotune_files import Refused, number

__all__ = ["CENTI", "CM", "CM_S", "MM", "MS", "PERCENT", "RADIANS", "Limit", "UnitMistake", "finite"]

_TO_SI: Mapping[str, float] = {"deg": math.pi / 180.0, "deg/s": math.pi / 180.0, "%": 0.01, "min": 60.0}
"""Unit as typed -> factor to SI. Other units are SI already."""
_TIMES: Mapping[str, float] = {"s": 1.0, "min": 60.0, "h": 3600.0}
"""Unit of time -> seconds. A time can be typed in any of these units."""
_WITH_UNIT = re.compile(r"([^a-z]+(?:e[+-]?\d+)?) ?(s|min|h)")
_ROUNDING = 1e-9
"""Relative tolerance of a limit, for rounding to radians and back."""


@dataclass(frozen=True, slots=True)
class UnitMistake:
    """A common unit mistake: the user typed the value in the unit *words*, so the intended value is ``factor`` times
    it."""

    factor: float
    words: str


PERCENT = UnitMistake(0.01, "in percent")
CENTI = UnitMistake(0.01, "in hundredths of a degree")
RADIANS = UnitMistake(180.0 / math.pi, "in radians")
CM = UnitMistake(0.01, "in centimetres")
CM_S = UnitMistake(0.01, "in cm/s")
MS = UnitMistake(0.001, "in milliseconds")
MM = UnitMistake(0.001, "in millimetres")


@dataclass(frozen=True, slots=True)
class Limit:
    """The limit of one number. ``least`` and ``greatest`` are in ``unit``, as typed.

    Attributes
    ----------
    name : the option without its dashes.
    meaning : text of the help; ``unset`` describes the default if there is no number ``default``.
    reason : why the range ends where it does.
    axis : the axis it belongs to, if unit and range depend on it; empty for all.
    mistakes : likely unit mistakes that explain a value outside the range.
    whole : whether it is a whole number. signed : whether it may be negative; its magnitude is then limited.
    """

    name: str
    meaning: str
    unit: str
    least: float
    greatest: float
    reason: str
    default: float | None = None
    unset: str = ""
    axis: str = ""
    mistakes: tuple[UnitMistake, ...] = ()
    whole: bool = False
    signed: bool = False

    @property
    def range(self) -> str:
        """Text of the range, e.g. ``2 to 120 deg``, ``0.02 to 1``."""
        ends = f"{_shown(self.least)} to {_shown(self.greatest)}"
        return ends + (f" {self.unit}" if self.unit else "") + (" in either direction" if self.signed else "")

    @property
    def factor(self) -> float:
        """Factor from the typed value to SI and radians."""
        return _TO_SI.get(self.unit, 1.0)

    @property
    def help(self) -> str:
        """Text of the help: meaning, range and default."""
        default = f" (default {_shown(self.default)})" if self.default is not None else ""
        unset = f" (default: {self.unset})" if self.unset else ""
        return f"{self.meaning}, {self.range}{default}{unset}"

    def parse(self, text: str) -> float:
        """Return the number typed as *text*.

        Raises
        ------
        UsageError
            It is not a number, not finite, or out of range; the message suggests the likely value.
        """
        try:
            value = number(text) if self.unit not in _TIMES else self._time(text)
        except Refused as error:
            raise UsageError(f"{error}. {self._wanted}{self._comma(text)}") from None
        return self.check(value)

    def _time(self, text: str) -> float:
        """Parse a time in ``unit`` or with its own unit (``90s``, ``30min``).

        Raises ``Refused`` if it is not a time.
        """
        found = _WITH_UNIT.fullmatch(text.strip())
        return number(text) if found is None else number(found[1]) * _TIMES[found[2]] / _TIMES[self.unit]

    def check(self, value: float) -> float:
        """Return *value* (as typed, in ``unit``) if it is valid.

        Raises
        ------
        UsageError
            It is invalid. The message states the range, the reason and the likely value.
        """
        if not math.isfinite(value):
            raise UsageError(f"{value:g} is not a finite number. {self._wanted}")
        if self.whole and value != round(value):
            raise UsageError(f"{value:g} is not a whole number. {self._wanted}")
        if not self._holds(value):
            raise UsageError(f"{_shown(value)} is out of range. {self._wanted}{self._meant(value)}")
        return int(value) if self.whole else value

    def check_si(self, value: float) -> None:
        """Check *value* in SI and radians; errors as for :meth:`check`, with the name."""
        try:
            self.check(value / self.factor)
        except UsageError as error:
            raise UsageError(f"{self.name}: {error}") from None

    def _holds(self, value: float) -> bool:
        size = abs(value) if self.signed else value
        slack = 0.0 if self.whole else _ROUNDING
        return self.least - slack * abs(self.least) <= size <= self.greatest + slack * abs(self.greatest)

    @property
    def _wanted(self) -> str:
        return f"Allowed: {self.range} ({self.reason})"

    def _meant(self, value: float) -> str:
        for slip in self.mistakes:
            meant = float(f"{value * slip.factor:.6g}")
            if self._holds(meant):
                return f". Did you mean {_shown(meant)} ({_shown(value)} {slip.words})?"
        if self._holds(-value):
            return f". Did you mean {_shown(-value)}?"
        nearest = self.least if value < self.least else self.greatest
        usual = f"; the default is {_shown(self.default)}" if self.default is not None else ""
        return (
            f". The nearest allowed value is {_shown(math.copysign(nearest, value) if self.signed else nearest)}{usual}"
        )

    def _comma(self, text: str) -> str:
        try:
            value = number(text.replace(",", "."))
        except Refused:
            return ""
        return f". Did you mean {text.replace(',', '.')}?" if self._holds(value) else ""


def finite(text: str) -> float:
    """Return the number written as *text*, of any size.

    Raises
    ------
    UsageError
        It is not a finite number.
    """
    try:
        return number(text)
    except Refused as error:
        raise UsageError(str(error)) from None


def _shown(value: float) -> str:
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e12 else f"{value:.6g}"
