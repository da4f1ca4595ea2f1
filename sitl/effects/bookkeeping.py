"""Errors in the record: wrong clocks, units, signs and labels. They do not affect the craft."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting

__all__ = [
    "ChannelSwap",
    "SignError",
    "TimeOffset",
    "TimeScale",
    "UnitError",
]


_CARRIED_TOGETHER = ({"N", "X", "Z"}, {"phi", "theta", "psi", "p", "q", "r"}, {"x", "y", "z"}, {"u", "v", "w"})
"""Columns that a vehicle can exchange, because one message contains them."""


class TimeScale(HiddenEffect):
    """Wrong rate of the record's clock: file time = factor times true time."""

    slug = "time-scale"
    meaning = "the clock of the record runs too fast or too slow"
    parameters = (EffectParameter("factor", "1", least=1e-6),)
    on_vehicles = "the timestamps of all messages"
    places = ("t",)

    def alter_file(self, columns: dict[str, NDArray[np.float64]]) -> None:
        """Multiply the file's time stamps by ``factor``."""
        columns["t"] = self["factor"] * columns["t"]

    def alter_report(self, fields: dict[str, float]) -> None:
        """Multiply the message's time stamp by ``factor``."""
        if "t" in fields:
            fields["t"] *= self["factor"]


class TimeOffset(HiddenEffect):
    """Time offset: the signals' time stamps are late relative to those of the inputs (negative: early)."""

    slug = "time-offset"
    meaning = "commands and signals are stamped by different clocks"
    parameters = (EffectParameter("offset", "s"),)
    on_vehicles = "the time stamps of servo reports relative to all others"
    places = ("t",)

    def lateness(self) -> Mapping[str, float]:
        """Return the offset [s], under ``*`` for all signals."""
        return {"*": self["offset"]}

    def alter_report(self, fields: dict[str, float]) -> None:
        """Subtract the offset from the time stamp of a servo report, so that the motion appears late."""
        if "t" in fields and "servo" in fields:
            fields["t"] -= self["offset"]


class OnColumns(HiddenEffect):
    """An error in the columns of the file that the place selects."""

    count = 1

    def begin(self, setting: Setting) -> None:
        """Find the columns that the effect's place selects."""
        names = tuple(setting.axis_names.get(name, name) for name in self.place.split("+"))
        known = (*setting.inputs, *setting.signals)
        if len(names) != self.count or not set(names) <= set(known):
            wanted = "one column" if self.count == 1 else "two columns joined by +"
            raise BadEffect(
                f"{self.slug} needs {wanted} as its place, chosen from {', '.join(known)}. '{self.place}' is not valid"
            )
        if self.count > 1 and setting.on_vehicle and not any(set(names) <= carried for carried in _CARRIED_TOGETHER):
            raise BadEffect(f"{self.slug}: no message contains both {' and '.join(names)}")
        self._names = names


class UnitError(OnColumns):
    """A column in another unit than its heading states."""

    slug = "unit-error"
    meaning = "a column is in another unit than its header states"
    parameters = (EffectParameter("factor", "1", "value in the file divided by the true value"),)
    on_vehicles = "a reported signal or axis (psi, r, u, z, ..., steering)"

    def alter_file(self, columns: dict[str, NDArray[np.float64]]) -> None:
        """Multiply the file's column by ``factor``."""
        columns[self._names[0]] = self["factor"] * columns[self._names[0]]

    def alter_report(self, fields: dict[str, float]) -> None:
        """Multiply the message's field by ``factor``, if the message contains it."""
        if self._names[0] in fields:
            fields[self._names[0]] *= self["factor"]


class SignError(OnColumns):
    """A column with the wrong sign."""

    slug = "sign-error"
    meaning = "a column has the wrong sign"
    on_vehicles = "a reported signal or axis (psi, r, u, z, ..., steering)"

    def alter_file(self, columns: dict[str, NDArray[np.float64]]) -> None:
        """Negate the file's column."""
        columns[self._names[0]] = -columns[self._names[0]]

    def alter_report(self, fields: dict[str, float]) -> None:
        """Negate the message's field, if the message contains it."""
        if self._names[0] in fields:
            fields[self._names[0]] = -fields[self._names[0]]


class ChannelSwap(OnColumns):
    """Two columns with each other's data."""

    slug = "channel-swap"
    meaning = "two columns are swapped"
    on_vehicles = "two fields of one message (x+y, p+q, p+r, phi+theta, two axes)"
    count = 2

    def alter_file(self, columns: dict[str, NDArray[np.float64]]) -> None:
        """Swap the file's two columns."""
        a, b = self._names
        columns[a], columns[b] = columns[b], columns[a]

    def alter_report(self, fields: dict[str, float]) -> None:
        """Swap the message's two fields, if the message contains them."""
        a, b = self._names
        if a in fields and b in fields:
            fields[a], fields[b] = fields[b], fields[a]
