"""Errors of the data: clocks, units, signs and columns.

They can look like physical effects, so both are searched together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import ClassVar

from gcs_autotune.effects.effect import Array, Drive, Effect, EffectInstance, Observed, Quantity, columns_of, concerns
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.models import Form
from gcs_autotune.sname import DOFS

__all__ = ["SLIPS", "ChannelSwap", "SignError", "TimeOffset", "TimeScale", "UnitError"]


class TimeScale(Effect):
    """File time is ``factor`` times true time, as with a wrong sample rate or a simulator faster than real time."""

    slug = "time-scale"
    family = "data errors"
    meaning = "the clock of the file runs fast or slow, because the sample rate is wrong or not real time"
    plain = "The clock of your recording runs too fast or too slow, so {simulation} seems to move at the wrong pace."
    parameters = (Quantity("factor", "1", "seconds in the file per true second"),)
    grows_with = ("factor",)
    neutral: ClassVar[Mapping[str, float]] = {"factor": 1.0}
    shown_by = "all positions change more (or less) than their velocities imply, by the same factor"
    mistaken_for = ("unit-error", "time-offset", "mass-change")
    separated_by = "a one-minute recording timed with a stopwatch. Its time stamps must span one minute"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the whole file, if a position and its velocity are measured.

        Otherwise the inertia and drag of the model absorb the error.
        """
        return ("t",) if rates_checked(data) else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return small and large factors in both directions."""
        return tuple({"factor": f} for f in (0.5, 0.85, 1.18, 2.0))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return a tenth to ten; a larger factor is a time column in another unit, which the file reader detects."""
        return {"factor": (0.1, 10.0)}

    def retime(self, effect: EffectInstance, t: Array, start: float, *, inputs: bool) -> Array:
        """Convert stamps to true time, which agrees with file time at the first stamp."""
        return start + (t - start) / effect["factor"]


class TimeOffset(Effect):
    """The stamps of the signals are later than those of the inputs by ``offset``.

    A negative offset means that the motion begins before its command.
    """

    slug = "time-offset"
    family = "data errors"
    meaning = "commands and motion have time stamps from two clocks that disagree"
    plain = "The commands and the motion in your recording have time stamps from two clocks that disagree."
    parameters = (Quantity("offset", "s", "delay of the signals' time stamps"),)
    yields_to = ("input-delay",)
    grows_with = ("offset",)
    shown_by = "the same residual after each change of command in every signal, correlated at one lag"
    mistaken_for = ("input-delay", "measurement-delay", "actuator-lag")
    separated_by = "two recordings of the same manoeuvre. A delay is the same in both. A clock offset changes"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the clocks of the file, if it contains commands."""
        return ("t",) if data.inputs else ()

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return offsets of two samples and of a fraction of the craft's time constant, in both directions."""
        low, high = self.bounds(place, data)["offset"]
        sizes = (2.0 * data.interval, max(0.3 * data.time_constant, 4.0 * data.interval))
        return tuple({"offset": min(max(sign * s, 0.8 * low), 0.8 * high)} for s in sizes for sign in (-1.0, 1.0))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return two time constants or a dozen samples, whichever is longer, but at most a quarter of a run."""
        most = min(max(2.0 * data.time_constant, 12.0 * data.interval), 0.25 * data.duration)
        return {"offset": (-most, most)}

    def retime(self, effect: EffectInstance, t: Array, start: float, *, inputs: bool) -> Array:
        """Convert the stamps of the inputs to the clock of the signals."""
        return t + effect["offset"] if inputs else t


SLIPS: Mapping[str, tuple[float, ...]] = {
    "rad": (180.0 / math.pi, 0.5 / math.pi),
    "rad/s": (180.0 / math.pi, 30.0 / math.pi, 0.5 / math.pi),
    "m": (1.0 / 0.3048, 100.0, 1000.0),
    "m/s": (3600.0 / 1852.0, 3.6, 1.0 / 0.3048, 1.852, 100.0, 1000.0),
    "N": (1.0 / 9.80665, 0.001, 0.22480894),
    "N m": (1.0 / 9.80665, 0.001, 0.73756215),
    "1": (100.0,),
}
"""SI unit -> number in the file per number in SI, for usual unit mistakes; each also occurs in the reverse
direction."""


class UnitError(Effect):
    """The number in the file is ``factor`` times the true one.

    The factor is one of :data:`SLIPS`. It is selected, not fitted.
    """

    slug = "unit-error"
    family = "data errors"
    meaning = "the numbers of a column are in a different unit from the one in its header"
    plain = "In your recording the {signal} is in a different unit from the one in its column header."
    parameters = (Quantity("factor", "1", "number in the file per true number in SI units"),)
    shown_by = "related columns disagree: a position changes 57.3, 3.6 or 1.94 times as much as its rate implies"
    mistaken_for = ("time-scale", "steady-current")
    separated_by = "a known motion, such as one full turn or a measured distance covered both ways"
    fixed = ("factor",)

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the columns whose scale is determined by other columns or known numbers."""
        signals = tuple(s for s, unit in data.signals.items() if unit in SLIPS and signal_scale_shows(s, data))
        inputs = tuple(c for c, unit in data.inputs.items() if unit in SLIPS and input_scale_shows(c, data))
        return signals + inputs

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return every usual unit mistake of this unit, in both directions."""
        unit = data.signals.get(place, data.inputs.get(place, ""))
        return tuple({"factor": f} for slip in SLIPS[unit] for f in (slip, 1.0 / slip))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the range of factors in :data:`SLIPS`."""
        return {"factor": (1e-3, 1e3)}

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Calculate the true command from the column."""
        u = drive.channels.get(effect.place)
        return drive if u is None else drive.with_channel(effect.place, u / effect["factor"])

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Convert the signal to the wrong unit."""
        y = seen.signals.get(effect.place)
        return seen if y is None else seen.with_signal(effect.place, y * effect["factor"])


class SignError(Effect):
    """A column has the wrong sign, in all runs (``"N"``) or in one (``"N@run"``)."""

    slug = "sign-error"
    family = "data errors"
    meaning = "a column has the wrong sign: positive to port, positive upwards, or a reversed connector"
    plain = "In your recording the {signal} has the wrong sign."
    shown_by = "the simulation moves the opposite way at every command, or heading and rate disagree"
    mistaken_for = ("channel-swap", "time-offset")
    separated_by = "one long push to starboard (or ahead, or down), observed from outside the craft"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return every signal, and every input whose sign the model does not fit in any case.

        With several runs, each column is also returned for each run alone.
        """
        columns = (*data.signals, *(c for c in data.inputs if not sign_is_free(c, data.form)))
        # Of one run only, the sign of any input shows against the other runs.
        each = (*data.signals, *data.inputs) if len(data.runs) > 1 else ()
        return (*columns, *(f"{c}@{run}" for c in each for run in data.runs))

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Reverse the sign of the command."""
        (name,) = columns_of(effect.place)
        if name not in drive.channels or not concerns(effect.place, drive.run):
            return drive
        return drive.with_channel(name, -drive.channels[name])

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Reverse the sign of the signal."""
        (name,) = columns_of(effect.place)
        if name not in seen.signals or not concerns(effect.place, seen.run):
            return seen
        return seen.with_signal(name, -seen.signals[name])


class ChannelSwap(Effect):
    """Two columns, ``"a+b"``, contain each other's data: plugs, axes or column heads are exchanged."""

    slug = "channel-swap"
    family = "data errors"
    meaning = "two columns are exchanged, because plugs, axes or headers were swapped"
    plain = "In your recording two columns are exchanged: {signal}."
    shown_by = "a motion follows the other channel's command, and each of two residuals resembles the other signal"
    mistaken_for = ("sign-error", "coriolis-coupling", "sway-yaw-coupling")
    separated_by = "one axis at a time: push on one, rest, then push on the other"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return pairs of signals of one unit, and pairs of inputs whose exchange would not only exchange free
        gains."""
        signals = [(a, b) for a, b in combinations(data.signals, 2) if data.signals[a] == data.signals[b]]
        inputs = [(a, b) for a, b in combinations(data.inputs, 2) if not _alike(a, b, data)]
        return tuple(f"{a}+{b}" for a, b in (*signals, *inputs))

    def drive(self, effect: EffectInstance, drive: Drive) -> Drive:
        """Exchange two commands."""
        a, b = columns_of(effect.place)
        if a not in drive.channels or b not in drive.channels:
            return drive
        first, second = drive.channels[a], drive.channels[b]
        return drive.with_channel(a, second).with_channel(b, first)

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Exchange two signals."""
        a, b = columns_of(effect.place)
        if a not in seen.signals or b not in seen.signals:
            return seen
        first, second = seen.signals[a], seen.signals[b]
        return seen.with_signal(a, second).with_signal(b, first)


def _alike(a: str, b: str, data: DataSummary) -> bool:
    """Return whether the model cannot show an exchange: both inputs drive the same forces, with free gains."""
    form = data.form
    pairs = [form.inputs.get(c, ()) for c in (a, b)]
    free = all(isinstance(g, str) and g.lstrip("-") in form.free for own in pairs for _, g in own)
    return free and {f for f, _ in pairs[0]} == {f for f, _ in pairs[1]}


_PLANAR = ({"x", "y"}, {"u", "v"})


def signal_scale_shows(signal: str, data: DataSummary) -> bool:
    """Return whether a wrong scale of *signal* is identifiable.

    Forces are known only relative to the inertia. The scale is identifiable from another measured signal of the same
    kinematics: ``psi`` from ``r``, ``x`` and ``y`` from ``u`` and ``psi``. It is also identifiable if the inertia is
    known.
    """
    have = set(data.signals)
    for dof in DOFS.values():
        pair = (dof.position, dof.velocity)
        if signal in pair:
            other = pair[1 - pair.index(signal)]
            if other in have or (dof.name in data.form.dofs and _inertia_known(dof.name, data.form)):
                return True
    if signal in ("u", "v"):
        return bool(have & _PLANAR[0])
    if signal in ("x", "y"):
        return bool(have & _PLANAR[1]) or have >= {"x", "y", "psi"}
    return signal == "psi" and have >= {"x", "y"}


def rates_checked(data: DataSummary) -> bool:
    """Return whether a position and its velocity are measured; only then is a wrong clock rate identifiable."""
    have = set(data.signals)
    pairs = any(d.position in have and d.velocity in have for d in DOFS.values())
    return pairs or all(have & group for group in _PLANAR)


def input_scale_shows(channel: str, data: DataSummary) -> bool:
    """Return whether a wrong scale of an input is identifiable.

    Its gain must be known, and also the inertia or the gain of a second input.
    """
    form = data.form
    for force in _given(channel, form):
        dof = next(d.name for d in DOFS.values() if d.force == force)
        others = [c for c in data.inputs if c != channel and force in _given(c, form)]
        if others or _inertia_known(dof, form):
            return True
    return False


def sign_is_free(channel: str, form: Form) -> bool:
    """Return whether the model fits the sign of an input anyway: a rudder's, or any whose every gain is free."""
    return channel == "delta" or not _given(channel, form)


def _given(channel: str, form: Form) -> tuple[str, ...]:
    """Return the forces that *channel* drives with a known gain."""
    pairs = form.inputs.get(channel, ())
    return tuple(f for f, g in pairs if not (isinstance(g, str) and g.lstrip("-") in form.free))


def _inertia_known(dof: str, form: Form) -> bool:
    d = DOFS[dof]
    body = {"yaw": "I_z", "roll": "I_x", "pitch": "I_y"}.get(dof, "m")
    names = {body, f"{d.force}_{d.velocity}dot"}
    return not names & set(form.free) and bool(names & set(form.known))
