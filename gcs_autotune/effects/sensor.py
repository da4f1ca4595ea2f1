"""Effects of sensors on the signal: off-centre position, compass deviation, gyro bias, delayed reports."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_autotune.effects.effect import (
    SIGNAL,
    Array,
    Effect,
    EffectCurve,
    EffectInstance,
    Observed,
    Quantity,
    columns_of,
)
from gcs_autotune.effects.kernels import earlier
from gcs_autotune.effects.summary import DataSummary, top_speed
from gcs_autotune.models import LEVER_ARM, SHOWN_OFF_CENTRE, seen_off_centre
from gcs_autotune.sname import DOFS

__all__ = ["CompassDeviation", "GyroBias", "MeasurementDelay", "SensorPosition"]


class SensorPosition(Effect):
    """Effect: velocities, positions or both are measured at a point ``x_P`` ahead and ``y_P`` to starboard of the
    centre.

    For a craft with surge and yaw only, there is no sway to identify ``x_P``. It is then estimated only if ``v`` or a
    track is measured. Depth identifies the position if the model has pitch or roll.
    """

    slug = "sensor-position"
    family = "sensor"
    meaning = "the sensor is mounted off the centre, so turning appears as sway or as surge"
    plain = "The sensor of the {signal} is mounted off the centre of your craft, but at the centre in {simulation}."
    parameters = (
        Quantity("x_P", "m", "distance of the sensor ahead of the centre"),
        Quantity("y_P", "m", "distance of the sensor to starboard of the centre"),
    )
    grows_with = ("x_P", "y_P")
    shown_by = (
        "sway residual proportional to the turn rate, or track residual that follows the heading, however the craft is "
        "driven"
    )
    mistaken_for = ("sway-yaw-coupling", "coriolis-coupling", "steady-current")
    separated_by = "a turn on the spot. The track of a sensor off the centre is a circle with the offset as its radius"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the measured velocities, the track, and both together, each as one place.

        Depth is also returned if the model has pitch or roll.
        """
        form, seen = data.form, set(data.signals)
        if set(LEVER_ARM) & set(form.parameters):
            return ()
        found: list[str] = []
        if "yaw" in form.dofs:
            speeds = "+".join(n for n in ("u", "v") if n in seen)
            track = "x+y" if {"x", "y"} <= seen and {"surge", "sway"} <= set(form.dofs) else ""
            found = [place for place in (speeds, track) if place]
            found += [f"{speeds}+{track}"] if speeds and track else []
        tilts = bool({"pitch", "roll"} & set(form.dofs)) and bool({"z", "w"} & seen)
        return (*found, *["+".join(n for n in ("z", "w") if n in seen)][:tilts])

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values: the distance, ahead or abeam, at which turning contributes a fifth of the largest speed.

        Scaling gives the opposite sign.
        """
        turning = max(top_speed(d, data) for d in ("yaw", "pitch", "roll") if d in data.form.dofs)
        moving = max((top_speed(d, data) for d in ("surge", "sway", "heave") if d in data.form.dofs), default=1.0)
        size = 0.2 * moving / turning
        if columns_of(place) == ("u",):
            return ({"y_P": size},)
        if columns_of(place) == ("v",):
            return ({"x_P": size},)
        return ({"x_P": size, "y_P": 0.0}, {"x_P": 0.0, "y_P": size})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``x_P`` and ``y_P``: :data:`LONGEST` in both directions."""
        return {"x_P": (-LONGEST, LONGEST), "y_P": (-LONGEST, LONGEST)}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the signals converted to those at the sensor's position."""
        arm = (effect.values.get("x_P", 0.0), effect.values.get("y_P", 0.0))
        none = np.empty((len(seen.t), 0))
        true = {n: (y, none) for n, y in seen.signals.items()}
        for name in columns_of(effect.place):
            if name in true:
                mixed = {n: true[n] for n in (name, *SHOWN_OFF_CENTRE[name]) if n in true}
                seen = seen.with_signal(name, seen_off_centre(name, mixed, arm, {})[0])
        return seen


LONGEST = 200.0
"""Largest distance of a sensor from the centre [m]. Project choice: the size of a large ship."""


class CompassDeviation(Effect):
    """Effect: the compass shows ``psi + A + B sin(psi) + C cos(psi)``, because of iron and currents aboard.

    ``A``, a misaligned compass, is estimated only if a track ``x``, ``y`` is measured. Otherwise it is only another
    choice of north. At ``"psi+u+v"`` the velocities are those of a satellite receiver, rotated into the body frame with
    the same compass, as in :mod:`gcs_autotune.models.coupled.compass`.
    """

    slug = "compass-deviation"
    family = "sensor"
    meaning = "the compass error varies with the sine and cosine of the heading, because of iron and currents aboard"
    plain = "The error of your compass changes with the heading, but {simulation} assumes a perfect compass."
    parameters = (
        Quantity("B", "rad", "part proportional to the sine of the heading"),
        Quantity("C", "rad", "part proportional to the cosine of the heading"),
        Quantity("A", "rad", "constant part, from a misaligned compass (only if a track is recorded)"),
    )
    grows_with = ("B", "C")
    shown_by = "heading residual against heading: one wave per turn, although the gyro fits"
    mistaken_for = ("wind-moment", "steady-current", "tether-pull")
    separated_by = "two slow full turns, one each way. The error of a compass repeats at the same headings"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the place ``psi`` if the heading is measured, and also ``psi+u+v`` if both velocities are."""
        if "psi" not in data.signals:
            return ()
        return ("psi", "psi+u+v") if {"u", "v"} <= set(data.signals) else ("psi",)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of the coefficients: deviations of three degrees in both directions."""
        A = {"A": 0.0} if _tracked(data) else {}
        return ({"B": 0.05, "C": 0.0, **A}, {"B": 0.0, "C": 0.05, **A}, {"B": -0.05, "C": -0.05, **A})

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the coefficients: 40 degrees (0.7 rad). A compass with a larger error is defective."""
        names = ("B", "C", "A") if _tracked(data) else ("B", "C")
        return dict.fromkeys(names, (-0.7, 0.7))

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the deviation added to the heading, and with velocities that depend on the compass
        rotated.
        """
        psi = seen.signals["psi"]
        d = _deviation(effect, psi)
        shown = seen.with_signal("psi", psi + d)
        if len(columns_of(effect.place)) == 1:
            return shown
        u, v = seen.signals["u"], seen.signals["v"]
        cosine, sine = np.cos(d), np.sin(d)
        return shown.with_signal("u", cosine * u + sine * v).with_signal("v", cosine * v - sine * u)

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve:
        """Return plot data: the deviation card, which is deviation over heading (polar)."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        return EffectCurve(
            psi, _deviation(effect, psi), "heading [rad]", "deviation [rad]", "Deviation card", polar=True
        )


def _deviation(effect: EffectInstance, psi: Array) -> Array:
    d: Array = effect.values.get("A", 0.0) + effect["B"] * np.sin(psi) + effect["C"] * np.cos(psi)
    return d


def _tracked(data: DataSummary) -> bool:
    return {"x", "y"} <= set(data.signals)


class GyroBias(Effect):
    """Effect: the gyro shows a turn rate that is too large by a constant ``bias``."""

    slug = "gyro-bias"
    family = "sensor"
    meaning = "the reading of the gyro is wrong by a constant rate"
    plain = "Your gyro shows a turn when there is none, but {simulation} assumes a perfect gyro."
    parameters = (Quantity("bias", SIGNAL, "reading of the gyro at rest"),)
    grows_with = ("bias",)
    shown_by = "mean of the rate residual, although the slope of the heading fits"
    mistaken_for = ("input-bias", "asymmetric-thrust", "compass-deviation")
    separated_by = "one minute moored or aground with the recorder running. Only a gyro with a bias still shows a turn"

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of the measured turn rates."""
        return tuple(s for s in ("r", "p", "q") if s in data.signals)

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a start value of ``bias``: a tenth of the rate's standard deviation.

        The effect is linear, so the search scales it.
        """
        return ({"bias": 0.1 * data.spread[place]},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``bias``: at most the largest recorded rate."""
        most = max((abs(v) for v in data.extent.get(place, ())), default=3.0 * data.spread[place])
        return {"bias": (-most, most)}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the bias added to the turn rate."""
        return seen.with_signal(effect.place, seen.signals[effect.place] + effect["bias"])


_POSITIONS = frozenset(d.position for d in DOFS.values())


class MeasurementDelay(Effect):
    """Effect: one signal, or all (``"psi+r"``), has the value of ``delay`` seconds ago, because of a sensor filter
    or a slow bus.
    """

    slug = "measurement-delay"
    family = "sensor"
    meaning = "a signal is reported late, because of filtering in the sensor or a slow bus"
    plain = "Your sensors report {signal} late, but {simulation} reports it at once."
    parameters = (Quantity("delay", "s", "age of the reported value"),)
    yields_to = ("input-delay", "time-offset")
    grows_with = ("delay",)
    shown_by = "residual proportional to the signal's rate of change. One signal is later than a related one"
    mistaken_for = ("time-offset", "input-delay", "actuator-lag")
    separated_by = (
        "a zig-zag with gyro and compass both recorded. A late sensor lags the other one. A late push delays both"
    )

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the name of each signal, and all names joined by ``+``."""
        names = tuple(data.signals)
        return (*names, "+".join(names)) if len(names) > 1 else names

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return start values of ``delay``: 1.5 samples, and 0.2 and 0.7 of the craft's time constant."""
        low, high = self.bounds(place, data)["delay"]
        sizes = {
            min(max(s, low), 0.8 * high)
            for s in (1.5 * data.interval, 0.2 * data.time_constant, 0.7 * data.time_constant)
        }
        return tuple({"delay": s} for s in sorted(sizes))

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of ``delay``: from 0 to two time constants or a dozen samples, whichever is longer.

        The upper bound is at most a quarter of a run.
        """
        return {"delay": (0.0, min(max(2.0 * data.time_constant, 12.0 * data.interval), 0.25 * data.duration))}

    def observe(self, effect: EffectInstance, seen: Observed) -> Observed:
        """Return *seen* with the signals delayed."""
        if effect["delay"] == 0.0:
            return seen
        t = np.ascontiguousarray(seen.t, dtype=np.float64)
        for name in columns_of(effect.place):
            if name in seen.signals:
                y = np.ascontiguousarray(seen.signals[name], dtype=np.float64)
                seen = seen.with_signal(name, earlier(t, y, effect["delay"], coasting=name in _POSITIONS))
        return seen
