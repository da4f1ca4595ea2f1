"""What a craft can do, computed from its identified models: speeds, turns, stops, and what it can hold against.

Every number comes from a simulation of the models, with the actuator effects that they contain. Its standard error
follows to first order from the covariance of the models. Sensors, waves, wind and current are left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from gcs_autotune.design.laws.rover_speed import pulse_of
from gcs_autotune.effects import EFFECTS, Characteristic, EffectInstance, ExtendedModel, ExtendedSimulator, passage_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.rounding import HALF_WIDTH

__all__ = [
    "ASTERN",
    "CURVE",
    "DEAD_ZONE",
    "RESERVE",
    "Authority",
    "AuthorityFigure",
    "Circle",
    "CraftModels",
    "FlownModel",
    "Missing",
    "authority_of",
]

Array = NDArray[np.float64]

RESERVE = 0.8
"""Fraction of what a craft can do that a limit or a held current may use; the rest is left to control. Chosen, as in
``control.choice``."""
THROTTLES = (0.25, 0.5, 0.75, 1.0)
"""Throttles of the turning circles [fraction of full], in addition to the working throttle."""
STOPPED = 0.1
"""Fraction of the speed at which a stop ends: that of the manoeuvre ``stopping``."""
DT = 0.05
"""Time between the samples of a simulation [s]."""
INTERVALS = (DT, 0.1 * DT, 0.01 * DT)
"""Times between the samples of the beginning of a turn [s], tried until the acceleration is resolved."""
RESOLVED = 50.0
"""Number of samples that the rise to :data:`RESERVE` of a turn rate must take."""
HORIZONS = (60.0, 240.0, 960.0, 3840.0)
"""Lengths of a simulation [s], tried until the motion is steady."""
STEADY = 2e-3
"""Relative change over the last quarter of a simulation below which a motion is steady."""
APPROACH = 10.0
"""Straight run before a stop or a turn [s], so that actuators settle."""

NUDGE = 0.5
"""Step of the difference quotients, in standard errors."""
NEAR_SPEED = 0.15
"""Relative distance from the speeds flown up to which a rudder's turn rates are used. Chosen."""
BEYOND = 1.25
"""Ratio of an output to the largest one flown, above which a figure is reported as an extrapolation. Chosen."""
RUDDER_POWER = 2.0
"""Exponent of a rudder's moment over speed if runs at one speed only are supplied: that of lift."""
ALIKE = 0.03
"""Difference of outputs [fraction of full] below which two states of the thrusters count as the same. Chosen."""
SLEW = 1.0
"""ArduRover's default MOT_SLEWRATE [fraction of full per second]."""
LEFT, RIGHT = 73, 74
"""SERVOn_FUNCTION of the thrusters of a boat that steers by their difference."""
CRUISE = 0.5
"""ArduRover's default CRUISE_THROTTLE [fraction of full]."""
INDISTINCT = 2.0
"""Standard errors of the constant force ahead below which it counts as zero."""
CRAFT = ("actuator", "hydrodynamics")
"""Families of effects that belong to the craft."""
CURVE, DEAD_ZONE, ASTERN = "quadratic-actuator", "dead-zone", "asymmetric-thrust"
"""Slugs of the effects that parameters of the autopilot correct."""
SIDES = (("port", -1.0), ("starboard", 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class FlownModel:
    """One identified model, with its uncertainty and what its runs flew.

    ``names``, ``covariance`` (p, p): of the fitted parameters. ``full``: input -> its value at full output. ``speed``
    [m/s]: mean of the runs; NaN if unknown. ``flown``: input -> smallest and largest output [fraction of full]; empty
    if unknown.
    """

    name: str
    model: ExtendedModel
    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    full: Mapping[str, float] = field(default_factory=dict)
    speed: float = math.nan
    flown: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def has(self, dof: str) -> bool:
        """Return whether the model has this degree of freedom."""
        return dof in self.model.base.form.dofs

    def drives(self, force: str) -> Mapping[str, float]:
        """Return input -> force at one unit of the input, of the inputs that drive *force*."""
        found: dict[str, float] = {}
        for channel, pairs in self.model.base.form.inputs.items():
            for letter, gain in pairs:
                if letter == force:
                    found[channel] = found.get(channel, 0.0) + _value(self.model, gain)
        return found

    def largest(self, force: str) -> float:
        """Return the largest output flown of the inputs that drive *force* [fraction]; NaN if unknown."""
        return max((max(-low, high) for c, (low, high) in self._flown(force)), default=math.nan)

    def flew_astern(self) -> bool:
        """Return whether thrust astern was flown, or identified by an effect."""
        return any(low < -0.05 for _, (low, _) in self._flown("X")) or self.effect(ASTERN, "X") is not None

    @property
    def astern(self) -> float | None:
        """Thrust astern over thrust ahead at the same output; None if no run of the model contains thrust astern."""
        own = self.effect(ASTERN, "X")
        if own is not None:
            return own["ratio"]
        return 1.0 if self.flew_astern() else None

    def _flown(self, force: str) -> Iterator[tuple[str, tuple[float, float]]]:
        return ((c, self.flown[c]) for c in self.drives(force) if c in self.flown)

    def effect(self, slug: str, force: str) -> EffectInstance | None:
        """Return the effect *slug* on an input that drives *force*, if the model has it."""
        return next((e for e in self.model.effects if e.slug == slug and e.place in self.drives(force)), None)

    def std(self, name: str) -> float:
        """Return the standard error of a fitted parameter; 0 if it has none."""
        return math.sqrt(max(self.covariance[(at := self.names.index(name)), at], 0.0)) if name in self.names else 0.0

    def craft_alone(self) -> FlownModel:
        """Return the model in calm water, with perfect sensors and without the constant force ahead of its runs."""
        if 0.0 < abs(self.model.base["X_0"]) <= INDISTINCT * self.std("X_0"):
            return self._without_force_ahead().craft_alone()
        base = self.model.base
        values = {n: v for n, v in base.values.items() if n not in ("V_x", "V_y")}
        values |= {n: 0.0 for n in ("X_0", "V_x", "V_y") if n in base.values}
        effects = tuple(
            e
            for e in self.model.effects
            if EFFECTS[e.slug].family in CRAFT or (e.slug == "input-bias" and e.place == "yaw")
        )
        return replace(self, model=replace(self.model, base=replace(base, values=values), effects=effects))

    def _without_force_ahead(self) -> FlownModel:
        """Return the estimate under the condition that the constant force ahead is zero."""
        k = self.names.index("X_0")
        column = self.covariance[:, k] / self.covariance[k, k]
        found, force = self, self.model.base["X_0"]
        for name, slope in zip(self.names, column, strict=True):
            found = found.shifted(name, -force * float(slope))
        values = {**found.model.base.values, "X_0": 0.0}
        model = replace(found.model, base=replace(found.model.base, values=values))
        return replace(found, model=model, covariance=self.covariance - np.outer(column, self.covariance[k]))

    def shifted(self, name: str, by: float) -> FlownModel:
        """Return the model with one fitted parameter changed."""
        base, model = self.model.base, self.model
        if name in base.values:
            base = replace(base, values={**base.values, name: base[name] + by})
            return replace(self, model=replace(model, base=base))
        effects = tuple(
            e.with_values({n: v + by for n, v in e.values.items() if e.label_of(n) == name}) for e in model.effects
        )
        return replace(self, model=replace(model, effects=effects))

    @property
    def straight(self) -> float:
        """The steering output that goes straight against the constant moment [fraction of full]."""
        constant = self.model.base["N_0"]
        ends = [self._of_actuators("N", side) + constant for side in (-1.0, 1.0)]
        if ends[0] * ends[1] >= 0.0:
            return 0.0
        return float(brentq(lambda output: self._of_actuators("N", output) + constant, -1.0, 1.0))

    def simulated(
        self, X: Array, N: Array, start: Mapping[str, float], Y: float = 0.0, t: Array | None = None
    ) -> dict[str, Array] | None:
        """Return every signal (n,) for outputs *X* and *N* (n,) [fraction of full] at the times *t* (n,) [s], by
        default at intervals of ``DT``; None if the motion diverges."""
        t = DT * np.arange(len(X), dtype=np.float64) if t is None else t
        ahead, turning, aside = (self.drives(force) for force in "XNY")
        commands = {}
        for channel in self.model.base.form.inputs:
            u = np.zeros(len(X))
            for gains, output in ((ahead, X), (turning, N), (aside, np.full(len(X), Y))):
                if gains.get(channel):
                    u = u + math.copysign(1.0, gains[channel]) * output
            commands[channel] = self.full.get(channel, 1.0) * np.clip(u, -1.0, 1.0)
        states = [n for n in ExtendedSimulator(self.model.base.form, self.model.effects).states if n in "uvrxy"]
        return self.model.predict(passage_of("authority", t, commands, dict.fromkeys(states, t)), start)

    def force(self, force: str, side: float) -> float:
        """Return the largest constant force to *side* [unit of the model], trim included."""
        return side * (self._of_actuators(force, side) + self.model.base[f"{force}_0"])

    def held(self, force: str, side: float) -> float:
        """Return the largest constant force to *side*, trim included. Of a normalised model, it is a fraction of the
        force at full output, which the actuators' curves set."""
        most, is_share = side * self._of_actuators(force, side), self.model.base.form.normalised
        return self.force(force, side) / (most if is_share and most > 0.0 else 1.0)

    def _of_actuators(self, force: str, output: float) -> float:
        """Return the force of the actuators [unit of the model] at an *output* of -1 to 1 of full."""
        found = 0.0
        for channel, gain in self.drives(force).items():
            u = np.array([output * math.copysign(1.0, gain) * self.full.get(channel, 1.0)])
            for own in self.model.effects:
                law = EFFECTS[own.slug]
                if own.place == channel and isinstance(law, Characteristic):
                    u = law.acting(own, u)
            found += gain * float(u[0])
        return found


@dataclass(frozen=True, slots=True, eq=False)
class CraftModels:
    """The models of one craft: surge, yaw by ascending speed, or one coupled model as both.

    ``settings``: parameters of the vehicle, as far as known. ``throttle``: the working throttle [fraction]; NaN takes
    CRUISE_THROTTLE. ``rover``: whether the autopilot is ArduRover (default if unknown).
    """

    surge: FlownModel | None
    yaw: Sequence[FlownModel]
    settings: Mapping[str, float] = field(default_factory=dict)
    throttle: float = math.nan
    rover: bool = True

    @property
    def coupled(self) -> bool:
        """Whether one model has surge and yaw."""
        return self.surge is not None and self.surge in self.yaw

    @property
    def skid(self) -> bool:
        """Whether it is known to steer by two thrusters."""
        functions = {v for n, v in self.settings.items() if n.startswith("SERVO") and n.endswith("_FUNCTION")}
        return {LEFT, RIGHT} <= functions

    @property
    def steers_by_speed(self) -> bool:
        """Whether it is a boat with a rudder, whose moment depends on speed."""
        return self.rover and not self.skid

    @property
    def working(self) -> float:
        """The working throttle [fraction of full]."""
        if math.isfinite(self.throttle):
            return self.throttle
        return self.settings.get("CRUISE_THROTTLE", 100.0 * CRUISE) / 100.0

    def outputs(self, throttle: float, steering: float) -> tuple[float, float]:
        """Return the outputs (X, N) that the vehicle sends, with those of two thrusters shared fairly.

        An unknown *throttle* is the working throttle.
        """
        throttle = self.working if math.isnan(throttle) else throttle
        X = pulse_of(throttle, self.settings) if self.rover else throttle
        return self._mixed(throttle, steering) if self.skid else (X, steering)

    def _mixed(self, throttle: float, steering: float) -> tuple[float, float]:
        """Return half the sum and half the difference of the two thrusters' outputs (AP_MotorsUGV, skid steering).

        Throttle and steering that do not fit together are reduced by the same factor, as with the default
        MOT_STR_THR_MIX. MOT_THST_ASYM raises outputs astern.
        """
        asymmetry = max(self.settings.get("MOT_THST_ASYM", 1.0), 1.0)
        floor = -1.0 / asymmetry
        middle = 0.5 * (1.0 + floor)
        reach = max(throttle, 0.0) - floor if throttle < middle else 1.0 - middle
        turn = math.copysign(min(abs(steering), reach), steering)
        most = max(throttle + abs(turn), (throttle - abs(turn)) / floor)
        if most > 1.0:
            turn /= most
            throttle = 1.0 - abs(turn) if throttle >= middle else abs(turn) + floor
        sides = [u if u >= 0.0 else asymmetry * u for u in (throttle + turn, throttle - turn)]
        left, right = (pulse_of(u, self.settings) for u in sides)
        return 0.5 * (left + right), 0.5 * (left - right)

    def ramp(self, before: float, after: float, seconds: float) -> Array:
        """Return X (n,) that changes from *before* to *after* at the vehicle's slew rate."""
        rate = self.settings.get("MOT_SLEWRATE", 100.0 * SLEW) / 100.0 if self.rover else 0.0
        change = np.full(round(seconds / DT) + 1, after)
        if rate > 0.0:
            size = np.minimum(rate * DT * np.arange(len(change)), abs(after - before))
            change = before + math.copysign(1.0, after - before) * size
        return change


@dataclass(frozen=True, slots=True)
class AuthorityFigure:
    """One figure with its standard error, in SI. ``note``: what it assumes. ``extrapolated``: whether it needs more
    output than was flown. The standard error then does not contain the error of the extrapolation.
    """

    slug: str
    title: str
    value: float
    std: float
    unit: str
    note: str = ""
    extrapolated: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval; NaN if the figure is extrapolated."""
        if self.extrapolated:
            return math.nan, math.nan
        return self.value - HALF_WIDTH * self.std, self.value + HALF_WIDTH * self.std

    @property
    def sure(self) -> float:
        """The end nearer to zero of the 95 % interval that follows from the standard error alone."""
        return math.copysign(max(abs(self.value) - HALF_WIDTH * self.std, 0.0), self.value)


@dataclass(frozen=True, slots=True)
class Circle:
    """A steady turn at full steering: throttle [fraction, NaN if unknown], speed, and per side rate and diameter."""

    throttle: float
    speed: AuthorityFigure
    rates: Mapping[str, AuthorityFigure]
    diameters: Mapping[str, AuthorityFigure]


@dataclass(frozen=True, slots=True)
class Missing:
    """What the inputs do not determine, and what to fly for it."""

    what: str
    fly: str


@dataclass(frozen=True, slots=True, eq=False)
class Authority(Displayed):
    """What a craft can do. ``figures``: by slug, only those that the inputs determine."""

    models: CraftModels
    figures: Mapping[str, AuthorityFigure]
    circles: Sequence[Circle]
    missing: Sequence[Missing]
    assumed: Sequence[str]


def authority_of(craft: CraftModels) -> Authority:
    """Return what *craft* can do, with standard errors and with what its models do not determine."""
    alone = replace(
        craft,
        surge=None if craft.surge is None else craft.surge.craft_alone(),
        yaw=tuple(m.craft_alone() for m in craft.yaw),
    )
    if craft.coupled:
        alone = replace(alone, surge=alone.yaw[0])
    values = dict(_numbers(alone))
    variance = dict.fromkeys(values, 0.0)
    for member in dict.fromkeys([*alone.yaw, *([alone.surge] if alone.surge else [])]):
        slopes = np.zeros((len(values), len(member.names)))
        for j, name in enumerate(member.names):
            std = member.std(name)
            if std > 0.0 and name not in ("X_0", "V_x", "V_y"):
                slopes[:, j] = _slopes(alone, member, name, NUDGE * std, list(values))
        spread = np.einsum("ij,jk,ik->i", slopes, member.covariance, slopes) if member.names else np.zeros(len(values))
        for slug, more in zip(values, spread, strict=True):
            variance[slug] += float(more)
    known = {s: (v, math.sqrt(max(variance[s], 0.0))) for s, v in values.items() if math.isfinite(v)}
    rows = [row for row in _titles(alone) if row[0] in known]
    figures = {}
    for slug, title, unit, note in rows:
        beyond = _extrapolation(alone, slug)
        note = "; ".join(text for text in (beyond, note) if text)
        figures[slug] = AuthorityFigure(slug, title, *known[slug], unit, note, bool(beyond))
    return Authority(
        craft, figures, tuple(_circles(alone, known)), tuple(_missing(craft, figures)), tuple(_assumed(craft, known))
    )


def _slopes(craft: CraftModels, member: FlownModel, name: str, by: float, slugs: Sequence[str]) -> Array:
    """Return the derivative (k,) of every number by one parameter of one model."""
    value = member.model.base.values.get(name)
    if value is None:
        labels = {e.label_of(n): v for e in member.model.effects for n, v in e.values.items()}
        if name not in labels:
            return np.zeros(len(slugs))  # of an effect outside the craft
        value = labels[name]
    least = 0.0 if value >= 0.0 and value - by < 0.0 and "@" in name else -by
    ends = []
    for step in (least, by):
        moved = member.shifted(name, step)
        yaw = tuple(moved if m is member else m for m in craft.yaw)
        found = dict(_numbers(replace(craft, surge=moved if craft.surge is member else craft.surge, yaw=yaw)))
        ends.append([found.get(slug, math.nan) for slug in slugs])
    slopes: Array = (np.array(ends[1]) - np.array(ends[0])) / (by - least)
    return slopes


def _value(model: ExtendedModel, gain: float | str) -> float:
    """Return an input's gain, which may be the name of a parameter, with a minus for its negative."""
    if not isinstance(gain, str):
        return float(gain)
    return -model.base[gain[1:]] if gain.startswith("-") else model.base[gain]


# ---- numbers -------------------------------------------------------------------------------------------------------


def _numbers(craft: CraftModels) -> Iterator[tuple[str, float]]:
    """Yield every number that the models determine, SI."""
    if craft.surge is not None:
        yield from _straight(craft, craft.surge)
    if craft.yaw:
        yield from _turns(craft)
    for model in dict.fromkeys([*craft.yaw, *([craft.surge] if craft.surge else [])]):
        if model.drives("Y") and model.has("sway"):
            for side, sign in SIDES:
                yield f"side-force-{side}", model.held("Y", -sign)


def _straight(craft: CraftModels, surge: FlownModel) -> Iterator[tuple[str, float]]:
    working = craft.outputs(craft.working, 0.0)[0]
    cruise, top = _speed(surge, working), _speed(surge, 1.0)
    yield "cruise-speed", cruise
    yield "top-ahead", top
    yield "current", _speed(surge, craft.outputs(RESERVE, 0.0)[0])
    yield "acceleration", cruise / _time_to(craft, surge, cruise)
    orders = [("coasting", 0.0)]
    if surge.flew_astern():
        yield "top-astern", (astern := -_speed(surge, -1.0))
        yield "astern-ratio", astern / top
        orders.append(("astern", -1.0))
    for how, order in orders:
        for where, X, speed in (("", working, cruise), ("-top", 1.0, top)):
            seconds, distance = _stop(craft, surge, X, speed, order)
            yield f"stop-{how}{where}", distance
            yield f"stop-time-{how}{where}", seconds
            if not where:
                yield f"deceleration-{how}", (1.0 - STOPPED) * speed / seconds


def _speed(surge: FlownModel, X: float) -> float:
    found = _steady(surge, X, 0.0)
    return math.nan if found is None else found["u"]


def _steady(model: FlownModel, X: float, N: float, start: Mapping[str, float] | None = None) -> dict[str, float] | None:
    """Return the steady velocities under constant outputs; None if unknown, diverging or never steady."""
    if not (math.isfinite(X) and math.isfinite(N)):
        return None
    for seconds in HORIZONS:
        n = round(seconds / DT)
        moved = model.simulated(np.full(n, X), np.full(n, N), start or {})
        if moved is None:
            return None
        velocities = {name: moved[name] for name in "uvr" if name in moved}
        late = {name: values[-n // 4 :] for name, values in velocities.items()}
        size = max(float(np.abs(values).max()) for values in late.values())
        if all(float(np.ptp(values)) <= STEADY * max(size, 1e-9) for values in late.values()):
            return {name: float(values[-1]) for name, values in late.items()}
    return None


def _time_to(craft: CraftModels, surge: FlownModel, speed: float) -> float:
    """Return the time [s] from rest to *speed* at full throttle."""
    if not math.isfinite(speed):
        return math.nan
    for seconds in HORIZONS:
        X = craft.ramp(0.0, 1.0, seconds)
        moved = surge.simulated(X, np.zeros(len(X)), {})
        if moved is None:
            return math.nan
        when = _crossing(moved["u"], speed)
        if math.isfinite(when):
            return when
    return math.nan


def _crossing(values: Array, level: float, dt: float = DT) -> float:
    """Return the time [s] at which *values* (n,), *dt* [s] apart, first rise to *level*; NaN if they do not."""
    beyond = np.flatnonzero(values >= level)
    if not len(beyond):
        return math.nan
    k = int(beyond[0])
    if k == 0:
        return 0.0
    return float(dt * (k - 1 + (level - values[k - 1]) / (values[k] - values[k - 1])))


def _stop(craft: CraftModels, surge: FlownModel, X: float, speed: float, order: float) -> tuple[float, float]:
    """Return time [s] and distance [m] from *speed* at output *X* until it has fallen to a tenth."""
    if not math.isfinite(speed):
        return math.nan, math.nan
    before = round(APPROACH / DT)
    for seconds in HORIZONS:
        outputs = np.concatenate([np.full(before, X), craft.ramp(X, order, seconds)])
        moved = surge.simulated(outputs, np.zeros(len(outputs)), {"u": speed})
        if moved is None:
            return math.nan, math.nan
        u = moved["u"][before:]
        when = _crossing(-u, -STOPPED * speed)
        if math.isfinite(when):
            k = int(when / DT)
            inside = float(np.trapezoid(u[: k + 1], dx=DT))
            return when, inside + (when - k * DT) * 0.5 * (float(u[k]) + STOPPED * speed)
    return math.nan, math.nan


def _turns(craft: CraftModels) -> Iterator[tuple[str, float]]:
    for throttle in _throttles(craft) if craft.rover or craft.surge is not None else ():  # others turn on the spot
        label = "flown" if math.isnan(throttle) else f"{100.0 * throttle:.3g}"
        for side, sign in SIDES:
            speed, rate = _circle(craft, throttle, sign)
            yield f"circle-{label}-speed-{side}", speed
            yield f"circle-{label}-rate-{side}", rate
            yield f"circle-{label}-diameter-{side}", 2.0 * speed / rate
    working = math.nan if craft.surge is None else craft.working
    for side, sign in SIDES:
        _, rate = _circle(craft, working, sign)
        yield f"turn-rate-{side}", rate
        yield from _beginning(craft, working, side, sign, rate)
    port, starboard = (_circle(craft, working, sign)[1] for _, sign in SIDES)
    yield "turn-ratio", starboard / port
    if math.isfinite(port):
        for side, sign in SIDES:
            yield f"moment-{side}", _nearest(craft, _approach(craft, working)).held("N", -sign)
    yield from _steerage(craft)


def _throttles(craft: CraftModels) -> tuple[float, ...]:
    if craft.surge is None:
        return (math.nan,)
    return tuple(sorted({*THROTTLES, craft.working}))


def _approach(craft: CraftModels, throttle: float) -> float:
    """Return the straight speed [m/s] at *throttle*; that of the runs without a surge model."""
    if craft.surge is None:
        return craft.yaw[0].speed
    return _speed(craft.surge, craft.outputs(throttle, 0.0)[0])


def _nearest(craft: CraftModels, speed: float) -> FlownModel:
    """Return the yaw model flown nearest to *speed*."""
    known = [m for m in craft.yaw if math.isfinite(m.speed)]
    return min(known, key=lambda m: abs(m.speed - speed)) if known and math.isfinite(speed) else craft.yaw[0]


def _circle(craft: CraftModels, throttle: float, side: float) -> tuple[float, float]:
    """Return speed [m/s] and turn rate [rad/s], positive for *side*, of a steady turn at full steering; NaN if the
    models do not determine it."""
    X, N = craft.outputs(throttle, side)
    if craft.coupled and craft.surge is not None:
        found = _steady(craft.surge, X, N)
        if found is None:
            return math.nan, math.nan
        return math.hypot(found["u"], found.get("v", 0.0)), side * found["r"]
    speed = _approach(craft, throttle)
    if craft.skid:
        X, N = _two_thrusters(craft, X, N)
        speed = math.nan if craft.surge is None else _speed(craft.surge, X)
    rates = [_steady(model, 0.0, N) for model in craft.yaw]
    turned = [math.nan if found is None else side * found["r"] for found in rates]
    return speed, _at_speed(craft, speed, turned)


def _at_speed(craft: CraftModels, speed: float, values: Sequence[float]) -> float:
    """Return the value at *speed* from one per yaw model; NaN if a rudder was not flown near that speed."""
    if not craft.steers_by_speed:
        return values[0]
    flown = [m.speed for m in craft.yaw]
    if not all(map(math.isfinite, flown)):
        return values[0] if len(values) == 1 else math.nan
    low, high = (1.0 - NEAR_SPEED) * flown[0], (1.0 + NEAR_SPEED) * flown[-1]
    if math.isfinite(speed) and not low <= speed <= high:
        return math.nan
    return float(np.interp(speed, flown, values))


def _two_thrusters(craft: CraftModels, X: float, N: float) -> tuple[float, float]:
    """Return the outputs (X, N) that give the thrust of a turn in models of other runs; NaN if unknown.

    A thruster that turns astern is weaker, so that steering then pushes ahead, too. The yaw model holds for the
    thrusters as in its own runs.
    """
    yaw = craft.yaw[0]
    steered = yaw.largest("N")
    beside = min(yaw.flown.get("X", (math.nan, math.nan))[1], 1.0 - steered)
    reversed_in_runs, reverses = steered > beside + ALIKE, abs(N) > X + ALIKE
    ratio = None if craft.surge is None else craft.surge.astern
    if ratio is None:
        alike = reverses == reversed_in_runs and (not reverses or abs(X - beside) < ALIKE)
        return (math.nan if reverses else X), (N if alike else math.nan)
    ahead, turning = _thrust(X, N, ratio)
    scale = steered / _thrust(beside, steered, ratio)[1] if reversed_in_runs else 1.0
    return (ahead if ahead >= 0.0 else ahead / ratio), scale * turning


def _thrust(X: float, N: float, ratio: float) -> tuple[float, float]:
    """Return the thrust ahead and its difference of two thrusters, weaker astern by *ratio*."""
    left, right = (u if u >= 0.0 else ratio * u for u in (X + N, X - N))
    return 0.5 * (left + right), 0.5 * (left - right)


def _beginning(craft: CraftModels, throttle: float, side: str, sign: float, rate: float) -> Iterator[tuple[str, float]]:
    """Yield the greatest turn acceleration from a straight course, and its mean up to :data:`RESERVE` of the rate."""
    if not math.isfinite(rate):
        return
    speed = _approach(craft, throttle)
    X, N = craft.outputs(throttle, sign)
    model = _nearest(craft, speed)
    if not craft.coupled and craft.skid:
        X, N = _two_thrusters(craft, X, N)
    before, after = round(APPROACH / DT), round(HORIZONS[0] / DT)
    straight = craft.outputs(throttle, 0.0)[0] if craft.coupled else 0.0
    start = {"u": speed} if craft.coupled else {}
    level = model.straight
    X_t, N_t = (np.concatenate([np.full(before, a), np.full(after, b)]) for a, b in ((straight, X), (level, N)))
    for dt in INTERVALS:
        t = np.concatenate([DT * np.arange(before), DT * before + dt * np.arange(after)])
        moved = model.simulated(X_t, N_t, start, t=t)
        if moved is None:
            return
        r = sign * moved["r"][before:]
        seconds = _crossing(r, RESERVE * rate, dt)
        if not seconds <= RESOLVED * dt:
            break
    yield f"turn-acceleration-{side}", float(np.max(np.diff(r))) / dt
    yield f"turn-acceleration-mean-{side}", RESERVE * rate / seconds


def _steerage(craft: CraftModels) -> Iterator[tuple[str, float]]:
    """Yield the speed [m/s] below which full rudder does not turn the boat against its constant moment."""
    if not craft.steers_by_speed or craft.coupled:
        return
    last = craft.yaw[-1]
    if not math.isfinite(last.speed):
        return
    constant = last.model.base["N_0"]
    rudder = last.force("N", math.copysign(1.0, -constant)) + abs(constant)
    yield "steerage", last.speed * (abs(constant) / rudder) ** (1.0 / _power(craft)) if rudder > 0.0 else math.nan


def _power(craft: CraftModels) -> float:
    """Return the exponent of the rudder's moment over speed, from runs at two speeds."""
    first, last = craft.yaw[0], craft.yaw[-1]
    if not last.speed > (1.0 + NEAR_SPEED) * first.speed:
        return RUDDER_POWER
    gains = [-sum(abs(g) for g in m.drives("N").values()) / m.model.base["N_rdot"] for m in (first, last)]
    return max(math.log(gains[1] / gains[0]) / math.log(last.speed / first.speed), 0.1)


# ---- words ---------------------------------------------------------------------------------------------------------


def _titles(craft: CraftModels) -> Iterator[tuple[str, str, str, str]]:
    """Yield slug, title, unit and note of every figure, in the order of the page."""
    at = "" if craft.surge is None else f" at {100.0 * craft.working:.3g} % throttle"
    yield "cruise-speed", f"speed{at}", "m/s", ""
    yield "top-ahead", "top speed ahead", "m/s", ""
    yield "top-astern", "top speed astern", "m/s", ""
    yield "astern-ratio", "top speed, astern / ahead", "1", ""
    yield "current", f"current, at {100.0 * RESERVE:.0f} % throttle", "m/s", ""
    yield "acceleration", "acceleration at full throttle", "m/s^2", ""
    yield "deceleration-coasting", "deceleration without thrust", "m/s^2", ""
    yield "deceleration-astern", "deceleration with full astern", "m/s^2", ""
    for how, words in (("coasting", "coasting"), ("astern", "full astern")):
        for where, speed in (("", ""), ("-top", " from top speed")):
            yield f"stop-{how}{where}", f"stopping distance{speed}, {words}", "m", ""
            yield f"stop-time-{how}{where}", f"stopping time{speed}, {words}", "s", ""
    for side, _ in SIDES:
        yield f"turn-rate-{side}", f"turn rate to {side}{at}", "rad/s", ""
    for side, _ in SIDES:
        yield f"turn-acceleration-{side}", f"turn acceleration to {side}, greatest", "rad/s^2", ""
    for side, _ in SIDES:
        yield f"turn-acceleration-mean-{side}", f"turn acceleration to {side}, mean", "rad/s^2", ""
    yield "turn-ratio", "turn rate, starboard / port", "1", ""
    powered = craft.steers_by_speed and len(craft.yaw) < 2
    yield (
        "steerage",
        "steerage limit",
        "m/s",
        "the steerage limit assumes a steering moment that grows with the square of speed, like a rudder's"
        if powered
        else "",
    )
    unit = _unit(craft, "N")
    for side, _ in SIDES:
        yield f"moment-{side}", f"constant moment to {side}", unit, ""
    for side, _ in SIDES:
        yield f"side-force-{side}", f"constant side force to {side}", _unit(craft, "Y"), ""


def _unit(craft: CraftModels, force: str) -> str:
    model = next((m for m in (*craft.yaw, craft.surge) if m is not None and m.drives(force)), None)
    if model is None:
        return "1"
    inputs = [c for c in model.drives(force) if model.model.units.get(c, "") not in ("1", "rad")]
    return ("N m" if force == "N" else "N") if inputs and not model.model.base.form.normalised else "1"


def _beyond(craft: CraftModels, force: str, reach: float | None = None) -> str:
    """Return a note if the output *reach* [fraction], by default the full one, is beyond those flown; empty if it is
    not, or unknown."""
    flown, most = _reach(craft, force)
    most = most if reach is None else reach
    return f"extrapolated: largest output flown {100.0 * flown:.0f} %" if BEYOND * flown < most else ""


TURNING = ("turn-", "moment-", "steerage")
"""Beginnings of the slugs of the figures at full steering."""


def _extrapolation(craft: CraftModels, slug: str, throttle: float = math.nan) -> str:
    """Return a note if the figure *slug* needs more output than was flown; empty if it does not, or unknown.

    throttle : of a circle [fraction]; NaN if unknown.
    """
    if slug.startswith("side-force-"):
        return _beyond(craft, "Y")
    if slug.startswith("circle-"):
        ahead = _beyond(craft, "X", craft.outputs(throttle, 0.0)[0]) if math.isfinite(throttle) else ""
        return _beyond(craft, "N") or ahead
    if slug.startswith(TURNING):
        return _beyond(craft, "N")
    if slug == "current":
        return _beyond(craft, "X", craft.outputs(RESERVE, 0.0)[0])
    if slug in COASTING:
        return _beyond(craft, "X", craft.outputs(craft.working, 0.0)[0])
    return _beyond(craft, "X", 1.0)


COASTING = ("cruise-speed", "deceleration-coasting", "stop-coasting", "stop-time-coasting")
"""Figures that need no more than the working throttle."""


def _reach(craft: CraftModels, force: str) -> tuple[float, float]:
    """Return the largest output flown [fraction], NaN if unknown, and that of the figures."""
    if force == "X":
        return (math.nan if craft.surge is None else craft.surge.largest("X")), 1.0
    if force == "Y":
        models = (*craft.yaw, *([craft.surge] if craft.surge else []))
        return next((model.largest("Y") for model in models if model.drives("Y")), math.nan), 1.0
    if not craft.yaw:
        return math.nan, 1.0
    speed = _approach(craft, math.nan if craft.surge is None else craft.working)
    return _nearest(craft, speed).largest("N"), abs(craft.outputs(craft.working, 1.0)[1])


def _circles(craft: CraftModels, known: Mapping[str, tuple[float, float]]) -> Iterator[Circle]:
    labels = dict.fromkeys(slug.split("-")[1] for slug in known if slug.startswith("circle-"))
    for label in labels:
        throttle = math.nan if label == "flown" else float(label) / 100.0
        beyond = _extrapolation(craft, f"circle-{label}", throttle)

        def of(what: str, side: str, unit: str, label: str = label, beyond: str = beyond) -> AuthorityFigure | None:
            slug = f"circle-{label}-{what}-{side}"
            return AuthorityFigure(slug, what, *known[slug], unit, beyond, bool(beyond)) if slug in known else None

        speed, rates, diameters = (
            {side: found for side, _ in SIDES if (found := of(what, side, unit)) is not None}
            for what, unit in (("speed", "m/s"), ("rate", "rad/s"), ("diameter", "m"))
        )
        if speed and len(diameters) == len(SIDES):
            yield Circle(throttle, next(iter(speed.values())), rates, diameters)


def _missing(craft: CraftModels, figures: Mapping[str, AuthorityFigure]) -> Iterator[Missing]:
    if craft.surge is None:
        yield Missing(
            "Speeds, accelerations, stops, and the circle at other speeds."
            if craft.rover
            else "Speeds, accelerations, stops and turning circles.",
            "gcs-autotune tune speed" if craft.rover else "gcs-autotune fly relay --force X",
        )
    elif not craft.surge.flew_astern():
        why = (
            "no run of the speed model contains it"
            if craft.surge.flown
            else f"{craft.surge.name} does not state its runs"
        )
        again = "Then identify all runs together with --effects asymmetric-thrust@X"
        if not craft.coupled:
            again = (
                "Then fit it together with the speed run: gcs-autotune identify SPEED-RUN STOPPING-RUN --dof surge "
                "--start SPEED-RUN/model.json --effects asymmetric-thrust@X --save FILE"
            )
        yield Missing(
            f"Everything with thrust astern: {why}.", f"gcs-autotune fly stopping --throttle 1 --astern 1. {again}"
        )
    if not craft.yaw:
        yield Missing("Everything about turning.", "gcs-autotune tune heading")
        return
    if craft.surge is not None and not craft.skid and "turn-rate-port" not in figures:
        flown = ", ".join(f"{m.speed:.2f} m/s" for m in craft.yaw)
        yield Missing(
            f"Turns at the working speed of {figures['cruise-speed'].value:.2f} m/s: the yaw model is of {flown}.",
            f"gcs-autotune tune heading --throttle {craft.working:.2g}",
        )
    if craft.steers_by_speed and not craft.coupled and len(craft.yaw) < 2:
        yield Missing(
            "The turning circle at other speeds, and how the rudder's moment depends on speed.",
            f"gcs-autotune experiment heading --throttle {0.5 * craft.working:.2g}. Add its run "
            "directory to the authority command",
        )
    largest, reach = _reach(craft, "N")
    what = "zig-zag" if craft.rover else "steps --force N"
    full = f"gcs-autotune fly {what} --steering 1. Give its run directory in place of the present yaw model"
    if craft.skid and "turn-rate-port" not in figures:
        yield Missing(
            f"Turns at full steering and {100.0 * craft.working:.0f} % throttle. One thruster then pushes astern, but "
            "the models contain only thrust ahead.",
            f"{full}. For the circles, fly the stop with full astern too",
        )
    elif BEYOND * largest < reach:
        yield Missing(
            f"Turns at full steering: the runs used {100.0 * largest:.0f} % of {100.0 * reach:.0f} %, so the figures "
            "are extrapolated.",
            full,
        )
    if craft.rover and not any(m.drives("Y") for m in craft.yaw):
        yield Missing(
            "The side force (wind) that the craft can hold against. The models contain no sideways thrust.",
            "a track in wind. It shows the drift angle",
        )


def _assumed(craft: CraftModels, known: Collection[str]) -> Iterator[str]:
    turns = any(slug.startswith(("turn-rate", "circle-")) for slug in known)
    if craft.rover and not any(name.startswith("SERVO") for name in craft.settings):
        yield (
            "The vehicle's outputs are unknown. It is taken as a boat with a rudder that steers fully at any throttle. "
            "Give --parameters."
        )
    if not craft.coupled and craft.yaw and craft.surge is not None:
        yield "Speed and turning come from separate models. Loss of speed in the turn is not included."
    speeds = [model.speed for model in craft.yaw if math.isfinite(model.speed)]
    if turns and not craft.coupled and craft.steers_by_speed and speeds:
        flown = " and ".join(f"{speed:.3g}" for speed in speeds)
        yield (
            f"The turn rates are those of the heading runs at {flown} m/s. They are shown up to {NEAR_SPEED:.0%} "
            "beyond these speeds, with the same value."
        )
    if turns and not craft.coupled and craft.skid:
        yield "The turn rates hold at the speed that was flown. At full steering the two thrusters share their output."
    for force, models in (("N", craft.yaw), ("X", [craft.surge] if craft.surge else [])):
        curved = any(model.effect(slug, force) for model in models for slug in (CURVE, DEAD_ZONE))
        if curved and _beyond(craft, force):
            yield (
                f"Beyond {100.0 * _reach(craft, force)[0]:.0f} % of {force} output, the figures continue the thrust "
                "curve of the model. A curve that fits the runs as well may give other ones."
            )
    for model in dict.fromkeys([*craft.yaw, *([craft.surge] if craft.surge else [])]):
        if not model.flown:
            yield f"{model.name}: the file does not contain its runs. Full output is taken as flown."
        if not model.names:
            yield f"{model.name}: the file contains no covariance. Its figures have no interval."
