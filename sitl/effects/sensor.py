"""Sensor errors."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from random import Random

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.places import find_signals
from sitl.sensors import SensorReading

__all__ = [
    "CompassDeviation",
    "GyroBias",
    "MeasurementDelay",
    "Outliers",
    "Quantisation",
    "SensorPosition",
]

_MOTION = ("psi", "r", "u", "v", "w", "x", "y", "z")


class SensorPosition(HiddenEffect):
    """A sensor mounted ``x_P`` ahead and ``y_P`` to starboard of the origin, which measures the motion of its own
    position.
    """

    slug = "sensor-position"
    meaning = "the sensor of speed and position is off-centre, so a turn looks like sway"
    parameters = (
        EffectParameter("x_P", "m", "distance of the sensor ahead of the centre", 0.0),
        EffectParameter("y_P", "m", "distance of the sensor to starboard of the centre", 0.0),
    )
    on_vehicles = "signals joined by + (default u+v+x+y, or z+w for a craft that tilts)"

    def begin(self, setting: Setting) -> None:
        """Find the signals that the mounting position affects."""
        usual: tuple[str, ...] = ("u", "v", "x", "y")
        if not self.place and not set(usual) & set(setting.signals):
            raise BadEffect(
                f"sensor-position: neither speed nor position is measured here. Measured: {', '.join(setting.signals)}"
            )
        self._names = find_signals(self, setting, "") if self.place else usual
        strange = [name for name in self._names if name not in (*usual, "z", "w")]
        if strange:
            raise BadEffect(
                f"sensor-position: {strange[0]} does not depend on the sensor's position. Use u, v, x, y, z or w"
            )
        self._state = setting.state

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Add the motion of the sensor's position about the origin to the reading."""
        at, ahead, aside = self._state, self["x_P"], self["y_P"]
        c, s = math.cos(at.psi), math.sin(at.psi)
        apart = {
            "u": -aside * at.r,
            "v": ahead * at.r,
            "x": ahead * c - aside * s,
            "y": ahead * s + aside * c,
            "z": aside * math.sin(at.phi) - ahead * math.sin(at.theta),
            "w": aside * at.p - ahead * at.q,
        }
        for name in self._names:
            setattr(reading, name, getattr(reading, name) + apart[name])


_NEEDLE = 1.0
"""Largest deviation [rad].

Above it one reading would belong to several headings; good compasses stay within 0.1. Project choice.
"""


class CompassDeviation(HiddenEffect):
    """Compass error due to iron on the craft, a constant and a semicircular deviation: ``A + B sin psi + C cos
    psi``.
    """

    slug = "compass-deviation"
    meaning = "iron aboard deflects the compass (sine and cosine of the heading)"
    parameters = (
        EffectParameter("B", "rad", default=0.0, least=-_NEEDLE, most=_NEEDLE),
        EffectParameter("C", "rad", default=0.0, least=-_NEEDLE, most=_NEEDLE),
        EffectParameter("A", "rad", "misalignment of the lubber line", 0.0, least=-math.pi, most=math.pi),
    )
    on_vehicles = "psi"

    def begin(self, setting: Setting) -> None:
        """Verify that the craft has a compass."""
        find_signals(self, setting, "psi")

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Add the deviation at the true heading to the measured heading."""
        reading.psi += self["A"] + self["B"] * math.sin(reading.psi) + self["C"] * math.cos(reading.psi)


class GyroBias(HiddenEffect):
    """Constant bias of a measured angular rate."""

    slug = "gyro-bias"
    meaning = "the gyro reports a rate at rest"
    parameters = (EffectParameter("bias", "rad/s"),)
    on_vehicles = "r (default), p, q"

    def begin(self, setting: Setting) -> None:
        """Find the angular rate that the effect's place selects."""
        (self._name,) = find_signals(self, setting, "r")[:1]
        if self._name not in ("p", "q", "r"):
            raise BadEffect(f"gyro-bias: '{self._name}' is not a gyro rate. Use r, p or q")

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Add the bias to the measured rate."""
        setattr(reading, self._name, getattr(reading, self._name) + self["bias"])


class MeasurementDelay(HiddenEffect):
    """Signals that are reported late. In the place, several are joined by ``+`` (``psi+r``), or it is ``all``."""

    slug = "measurement-delay"
    meaning = "a signal is reported late"
    parameters = (EffectParameter("delay", "s", least=0.0),)
    on_vehicles = "one signal, or several joined by + (default: all, psi+r+u+x+y+z+w)"

    def begin(self, setting: Setting) -> None:
        """Find the signals, and clear the stored readings."""
        everything = "+".join(name for name in setting.signals if name in _MOTION)
        self._names = tuple(everything.split("+")) if self.place in ("", "all") else find_signals(self, setting, "")
        self._seen: deque[tuple[float, tuple[float, ...]]] = deque()
        self._on_vehicle = setting.on_vehicle

    def lateness(self) -> Mapping[str, float]:
        """Return signal -> its delay [s]."""
        return dict.fromkeys(self._names, self["delay"])

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Replace each signal by its value ``delay`` earlier, interpolated between samples. In open loop do nothing,
        because the delay is applied to the file.
        """
        if not self._on_vehicle:
            return
        past, when = self._seen, t - self["delay"] + 1e-9
        past.append((t, tuple(getattr(reading, name) for name in self._names)))
        while len(past) > 1 and past[1][0] <= when:
            past.popleft()
        t0, old = past[0]
        t1, new = past[1] if len(past) > 1 else past[0]
        share = 0.0 if t1 <= t0 or when <= t0 else (when - t0) / (t1 - t0)
        for name, before, after in zip(self._names, old, new, strict=True):
            change = math.remainder(after - before, math.tau) if name == "psi" else after - before
            setattr(reading, name, before + share * change)


class Quantisation(HiddenEffect):
    """Readings rounded to multiples of a step."""

    slug = "quantisation"
    meaning = "a signal is quantised"
    parameters = (EffectParameter("step", "signal unit", least=1e-12),)
    on_vehicles = "a signal (default psi)"

    def begin(self, setting: Setting) -> None:
        """Find the signal that the effect's place selects."""
        self._names = find_signals(self, setting, "psi" if "psi" in setting.signals else setting.signals[0])

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Round the signal in the reading to a multiple of the step."""
        step = self["step"]
        for name in self._names:
            setattr(reading, name, round(getattr(reading, name) / step) * step)


class Outliers(HiddenEffect):
    """Some samples with large errors."""

    slug = "outliers"
    meaning = "some samples are far off"
    parameters = (
        EffectParameter("share", "1", "of the samples", least=0.0),
        EffectParameter("size", "signal unit", "rms"),
    )
    on_vehicles = "a signal (default psi)"

    def begin(self, setting: Setting) -> None:
        """Find the signal that the effect's place selects, and seed the random numbers."""
        self._names = find_signals(self, setting, "psi" if "psi" in setting.signals else setting.signals[0])
        self._draw = Random(f"{setting.seed}/{self.slug}/{self.place}")

    def alter_measurement(self, t: float, reading: SensorReading) -> None:
        """Add a large error to the signal in randomly chosen samples."""
        for name in self._names:
            struck, by = self._draw.random() < self["share"], self._draw.gauss(0.0, self["size"])
            if struck:
                setattr(reading, name, getattr(reading, name) + by)
