"""Actuators of the catalogue compared with independent computations: fine steps, loops, scipy's integrator."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance, effect_at, effect_words
from gcs_autotune.effects.actuator import quickest
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.trial import Channel

Array = NDArray[np.float64]

ACTUATORS = [
    "input-delay",
    "saturation",
    "rate-limit",
    "actuator-lag",
    "backlash",
    "dead-zone",
    "quadratic-actuator",
    "rudder-stall",
    "asymmetric-thrust",
    "gain-drift",
    "speed-dependent-steering",
    "advance-speed-loss",
]
LARGEST = 4.0
YAW = Form("plain", "yaw", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)
STAMPS = np.arange(0.0, 30.0, 0.1)
FINE = 1e-3


def data_summary(form: Form = YAW, *, tau: float = 1.0, **more: object) -> DataSummary:
    channels = {"N": (-LARGEST, LARGEST), "psi": (-1.0, 1.0), "r": (-0.5, 0.5), "u": (0.2, 1.5)}
    return DataSummary(
        form=form,
        inputs=dict.fromkeys(form.inputs, "N m"),
        signals={"psi": "rad", "r": "rad/s"},
        amplitude=dict.fromkeys(form.inputs, LARGEST),
        spread={"psi": 0.5, "r": 0.2},
        level={"psi": 0.01, "r": 0.01},
        channels=frozenset(channels),
        interval=0.1,
        time_constant=tau,
        duration=60.0,
        extent=channels,
        rms={"u": 1.0},
        base={"N_rdot": -tau, "N_r": -1.0},
        **more,  # type: ignore[arg-type]
    )


def commands(seed: int = 4) -> Array:
    """Steps of random size and length up to the largest command, among them full reversals, and a slow sine."""
    rng = np.random.default_rng(seed)
    u = np.zeros(len(STAMPS))
    u[20:60], u[60:90], u[90:120] = LARGEST, -LARGEST, 0.4 * LARGEST
    for i in range(120, 220, 10):
        u[i : i + 10] = rng.uniform(-LARGEST, LARGEST)
    u[220:] = LARGEST * np.sin(0.8 * (STAMPS[220:] - STAMPS[220]))
    return u


def drive_of(u: Array | None = None, **more: Array) -> Drive:
    t = np.arange(0.0, 30.0, 0.02)
    speed = Channel("u", "m/s", t, 0.9 + 0.6 * np.sin(0.4 * t))
    return Drive(STAMPS, {"N": commands() if u is None else u, **more}, 0.0, {"u": speed})


def applied(slug: str, **values: float) -> EffectInstance:
    return EffectInstance(slug, "N", values, dict(EFFECTS[slug].constants("N", data_summary(tau=0.1))))


def held(drive: Drive, at: Array, name: str = "N") -> Array:
    found: Array = drive.channels[name][np.maximum(np.searchsorted(drive.t, at, side="right") - 1, 0)]
    return found


def craft(t: Array, u: Array, tau: float, out: Array) -> Array:
    """Response of ``tau nu' = u - nu`` to held values, exact from stamp to stamp."""
    stops = np.union1d(t, out)
    nu, y = np.zeros(len(stops)), 0.0
    for i in range(1, len(stops)):
        push = u[max(np.searchsorted(t, stops[i - 1], side="right") - 1, 0)]
        y = push + (y - push) * math.exp(-(stops[i] - stops[i - 1]) / tau)
        nu[i] = y
    found: Array = nu[np.searchsorted(stops, out)]
    return found


def command_at(t: float, u: Array) -> float:
    return float(u[max(int(np.searchsorted(STAMPS, t, side="right")) - 1, 0)])


def between_stamps(rate_of: Callable[[float, float, float], float], u: Array, tau: float, out: Array) -> Array:
    """Integrate actuator and craft together, from stamp to stamp; ``rate_of(t, y, command)`` moves the actuator."""
    state, found = np.array([u[0], 0.0]), [0.0]
    for a, b in pairwise(out):
        command = command_at(0.5 * (a + b), u)
        step = solve_ivp(
            lambda t, s, c=command: [rate_of(t, s[0], c), (s[0] - s[1]) / tau],
            (a, b),
            state,
            rtol=1e-8,
            atol=1e-9,
            max_step=0.25 * (b - a),
        )
        state = step.y[:, -1]
        found.append(float(state[1]))
    return np.array(found)


def lag_then_craft(u: Array, T: float, tau: float, out: Array) -> Array:
    """Response to lagged commands in closed form: two exponentials between stamps."""
    y, nu, found = u[0], 0.0, np.zeros(len(out))
    for i in range(len(STAMPS)):
        end = STAMPS[i + 1] if i + 1 < len(STAMPS) else np.inf
        share = (y - u[i]) * T / (T - tau)
        rest = nu - u[i] - share
        mine = (out >= STAMPS[i]) & (out < end)
        t = out[mine] - STAMPS[i]
        found[mine] = u[i] + share * np.exp(-t / T) + rest * np.exp(-t / tau)
        if end < np.inf:
            h = end - STAMPS[i]
            y = u[i] + (y - u[i]) * math.exp(-h / T)
            nu = u[i] + share * math.exp(-h / T) + rest * math.exp(-h / tau)
    return found


def ramp_then_craft(u: Array, rate: float, tau: float, out: Array) -> Array:
    """Response to rate-limited commands in closed form: a ramp, then the command."""
    y, nu, found = u[0], 0.0, np.zeros(len(out))
    for i in range(len(STAMPS)):
        end = STAMPS[i + 1] if i + 1 < len(STAMPS) else 1e9
        reached = STAMPS[i] + abs(u[i] - y) / rate
        for a, b, slope in (
            (STAMPS[i], min(reached, end), math.copysign(rate, u[i] - y)),
            (min(reached, end), end, 0.0),
        ):
            start = u[i] if slope == 0.0 else y
            rest = nu - start + slope * tau
            mine = (out >= a) & (out < b)
            found[mine] = start + slope * (out[mine] - a - tau) + rest * np.exp(-(out[mine] - a) / tau)
            if b > a:
                nu = start + slope * (b - a - tau) + rest * math.exp(-(b - a) / tau)
        y += math.copysign(min(abs(u[i] - y), rate * (end - STAMPS[i])), u[i] - y)
    return found


EXACT: dict[str, Callable[[Array, float, float, Array], Array]] = {
    "actuator-lag": lag_then_craft,
    "rate-limit": ramp_then_craft,
}


# -- the laws


def test_a_delay_shifts_commands_exactly_and_holds_the_first_one_before() -> None:
    u = commands() + 1.0
    late = EFFECTS["input-delay"].drive(applied("input-delay", delay=0.237), drive_of(u))
    at = np.arange(0.0, 29.9, 0.0173)
    assert held(late, at) == pytest.approx([command_at(max(s - 0.237, 0.0), u) for s in at], abs=0)


def test_a_delay_of_one_channel_leaves_the_others_alone() -> None:
    other = np.cos(STAMPS)
    late = EFFECTS["input-delay"].drive(applied("input-delay", delay=0.237), drive_of(X=other))
    at = np.arange(0.0, 29.9, 0.0173)
    assert held(late, at, "X") == pytest.approx([command_at(s, other) for s in at], abs=0)
    assert held(late, at) == pytest.approx([command_at(max(s - 0.237, 0.0), commands()) for s in at], abs=0)


@pytest.mark.parametrize("others", [False, True])
def test_a_rate_limit_runs_after_the_command_at_its_rate(others: bool) -> None:
    u, rate = commands() + 1.0, 3.0
    more = {"X": np.cos(STAMPS)} if others else {}
    slow = EFFECTS["rate-limit"].drive(applied("rate-limit", rate=rate), drive_of(u, **more))
    y, worst = u[0], 0.0
    for i in range(29_900):
        worst = max(worst, abs(held(slow, np.array([(i + 0.5) * FINE]))[0] - y))
        y += float(np.clip(command_at((i + 0.5) * FINE, u) - y, -rate * FINE, rate * FINE))
    pieces = math.sqrt(applied("rate-limit", rate=rate)["resolution"] / rate)
    assert worst < 0.5 * rate * pieces + 2 * rate * FINE


def test_a_lag_follows_every_command_exponentially() -> None:
    u, T = commands() + 1.0, 0.7
    slow = EFFECTS["actuator-lag"].drive(applied("actuator-lag", time_constant=T), drive_of(u))
    y, errors = u[0], []
    for i in range(29_900):
        c = command_at((i + 0.5) * FINE, u)
        errors.append(held(slow, np.array([(i + 0.5) * FINE]))[0] - (c + (y - c) * math.exp(-0.5 * FINE / T)))
        y = c + (y - c) * math.exp(-FINE / T)
    assert abs(np.mean(errors)) < 1e-4 * LARGEST
    assert np.max(np.abs(errors)) < 0.05 * LARGEST


def test_backlash_drags_its_output_along_a_loop() -> None:
    u = commands() + 0.5
    y, expected = u[0], []
    for c in u:
        if c - 0.6 > y:
            y = c - 0.6
        elif c + 0.6 < y:
            y = c + 0.6
        expected.append(y)
    assert EFFECTS["backlash"].drive(applied("backlash", width=1.2), drive_of(u)).channels["N"] == pytest.approx(
        expected
    )


def _stall(u: float) -> float:
    if abs(u) <= 2.5:
        return u
    return math.copysign(max(2.5 - 1.5 * (abs(u) - 2.5), 0.0), u)


@pytest.mark.parametrize(
    ("own", "law"),
    [
        (applied("saturation", limit=1.5), lambda u: min(max(u, -1.5), 1.5)),
        (applied("dead-zone", width=0.7), lambda u: u - 0.7 if u > 0.7 else (u + 0.7 if u < -0.7 else 0.0)),
        (applied("quadratic-actuator", share=0.8), lambda u: 0.2 * u + 0.8 * u * abs(u) / LARGEST),
        (applied("rudder-stall", angle=2.5, drop=1.5), _stall),
        (applied("asymmetric-thrust", ratio=0.6), lambda u: u if u > 0 else 0.6 * u),
    ],
    ids=lambda a: a.slug if isinstance(a, EffectInstance) else "",
)
def test_static_curves_keep_their_law_in_drive_and_plot(own: EffectInstance, law: Callable[[float], float]) -> None:
    entry = EFFECTS[own.slug]
    assert entry.drive(own, drive_of()).channels["N"] == pytest.approx([law(c) for c in commands()], abs=1e-12)
    plot = entry.curve(own, data_summary())
    assert plot is not None
    assert plot.y == pytest.approx([law(float(c)) for c in plot.x], abs=1e-12)


@pytest.mark.parametrize("rate", [0.02, 0.05, -0.02])
def test_gain_drifts_from_the_first_stamp_and_stays_above_a_twentieth(rate: float) -> None:
    sparse = Drive(np.array([2.0, 8.0, 21.0]), {"N": np.array([3.0, -4.0, 1.0])}, 1.0, drive_of().measured)
    faded = EFFECTS["gain-drift"].drive(applied("gain-drift", rate=rate), sparse)
    out = np.arange(2.0, 29.9, 0.1)
    fine = np.arange(2.0, 30.0, FINE)
    gain = np.maximum(1.0 - rate * (fine + 0.5 * FINE - 1.0), 0.05)
    u = np.array([3.0, -4.0, 1.0])[np.searchsorted(sparse.t, fine + 0.5 * FINE, side="right") - 1]
    expected, seen = craft(fine, gain * u, 0.1, out), craft(faded.t, faded.channels["N"], 0.1, out)
    assert np.abs(seen - expected).max() < 1e-3 * LARGEST


def test_steering_grows_with_the_square_of_the_measured_speed() -> None:
    own = EffectInstance("speed-dependent-steering", "N", {"share": 0.7}, {"U_ref": 1.1})
    flown = EFFECTS[own.slug].drive(own, drive_of())
    at = np.arange(0.013, 29.5, 0.0473)
    speed = 0.9 + 0.6 * np.sin(0.4 * at)
    expected = [command_at(s, commands()) * (0.3 + 0.7 * (v / 1.1) ** 2) for s, v in zip(at, speed, strict=True)]
    assert held(flown, at) == pytest.approx(expected, abs=0.01 * LARGEST)


def test_steering_is_little_affected_by_noise_in_the_speed() -> None:
    t = np.arange(0.0, 30.0, 0.1)
    noisy = Channel("u", "m/s", t, 1.0 + 0.1 * np.random.default_rng(1).standard_normal(len(t)))
    own = EffectInstance("speed-dependent-steering", "N", {"share": 1.0}, {"U_ref": 1.0})
    flown = EFFECTS[own.slug].drive(own, Drive(STAMPS, {"N": np.ones(300)}, 0.0, {"u": noisy}))
    assert np.std(flown.channels["N"][10:-10]) < 0.6 * 2.0 * 0.1


def test_steering_is_unchanged_without_a_recorded_speed() -> None:
    own = EffectInstance("speed-dependent-steering", "N", {"share": 0.7}, {"U_ref": 1.1})
    drive = Drive(STAMPS, {"N": commands()}, 0.0)
    assert EFFECTS[own.slug].drive(own, drive) is drive


# -- the resulting motion of a craft


@pytest.mark.parametrize("tau", [0.1, 1.0, 20.0])
@pytest.mark.parametrize("T", [0.02, 0.3, 3.0])
def test_a_lag_held_in_pieces_is_exact_at_the_stamps(tau: float, T: float) -> None:
    u, out = commands() + 0.3, STAMPS[:250]
    slow = EFFECTS["actuator-lag"].drive(applied("actuator-lag", time_constant=T), drive_of(u))
    expected = between_stamps(lambda t, y, c: (c - y) / T, u, tau, out)
    assert np.abs(craft(slow.t, slow.channels["N"], tau, out) - expected).max() < 1e-3 * LARGEST


@pytest.mark.parametrize("tau", [0.1, 1.0, 20.0])
@pytest.mark.parametrize(
    ("slug", "name", "value"),
    [("actuator-lag", "time_constant", T) for T in (0.02, 0.3, 3.0)]
    + [("rate-limit", "rate", rate) for rate in (0.8, 6.0, 70.0)],
)
def test_lags_and_rate_limits_are_exact_between_the_stamps(slug: str, name: str, value: float, tau: float) -> None:
    u, out = commands() + 0.3, np.arange(0.0, 25.0, 0.0371)
    moved = EFFECTS[slug].drive(applied(slug, **{name: value}), drive_of(u))
    expected = EXACT[slug](u, value, tau, out)
    assert np.abs(craft(moved.t, moved.channels["N"], tau, out) - expected).max() < 1e-3 * LARGEST


@pytest.mark.parametrize("rate", [0.8, 6.0])
def test_a_plain_euler_loop_gives_the_same_ramps(rate: float) -> None:
    u, h = commands() + 0.3, 5e-4
    fine, out = np.arange(0.0, 15.0, h), STAMPS[:140]
    y, nu, seen = u[0], 0.0, []
    for i, c in enumerate(u[np.searchsorted(STAMPS, fine + 0.5 * h, side="right") - 1]):
        if i % 200 == 0:
            seen.append(nu)
        last, y = y, y + min(max(c - y, -rate * h), rate * h)
        nu += h / 0.5 * (0.5 * (last + y) - nu)
    slow = EFFECTS["rate-limit"].drive(applied("rate-limit", rate=rate), drive_of(u))
    assert np.abs(craft(slow.t, slow.channels["N"], 0.5, out) - np.array(seen[:140])).max() < 2e-3 * LARGEST


@pytest.mark.parametrize(("slug", "values"), [("actuator-lag", {"time_constant": 0.3}), ("rate-limit", {"rate": 6.0})])
def test_stamps_are_added_after_changes_only_and_fewer_for_slow_craft(slug: str, values: dict[str, float]) -> None:
    t = np.arange(0.0, 600.0, 0.1)
    u = np.where((t // 60.0) % 2 == 0, LARGEST, -LARGEST)
    counts = []
    for tau in (0.1, 20.0):
        own = EffectInstance(slug, "N", values, EFFECTS[slug].constants("N", data_summary(tau=tau)))
        counts.append(len(EFFECTS[slug].drive(own, Drive(t, {"N": u}, 0.0)).t) - len(t))
    assert counts[0] < 9 * 120
    assert counts[1] < 0.5 * counts[0]


@pytest.mark.parametrize("slug", ["actuator-lag", "rate-limit"])
def test_an_actuator_keeps_moving_after_the_last_command(slug: str) -> None:
    value = {"actuator-lag": {"time_constant": 2.0}, "rate-limit": {"rate": 1.0}}[slug]
    moved = EFFECTS[slug].drive(
        applied(slug, **value), Drive(np.array([0.0, 1.0]), {"N": np.array([0.0, LARGEST])}, 0.0)
    )
    middle = {"actuator-lag": LARGEST * (1.0 - math.exp(-1.0)), "rate-limit": 2.0}[slug]
    assert held(moved, np.array([3.0]))[0] == pytest.approx(middle, abs=0.06)
    assert held(moved, np.array([100.0]))[0] == LARGEST


SMOOTH = [
    ("input-delay", "delay", 0.237),
    ("rate-limit", "rate", 3.7),
    ("actuator-lag", "time_constant", 0.61),
    ("gain-drift", "rate", 0.013),
    ("backlash", "width", 1.3),
    ("saturation", "limit", 1.7),
    ("rudder-stall", "angle", 1.7),
]


@pytest.mark.parametrize(("slug", "name", "value"), SMOOTH)
def test_small_and_smaller_differences_agree(slug: str, name: str, value: float) -> None:
    """No snapping to a grid: quotients over steps of 1e-3 and 1e-4 of the value agree."""

    def response(x: float) -> Array:
        values = {"drop": 1.0, name: x} if slug == "rudder-stall" else {name: x}
        moved = EFFECTS[slug].drive(applied(slug, **values), drive_of())
        return craft(moved.t, moved.channels["N"], 0.5, STAMPS)

    here = response(value)
    fine, finest = ((response(value * (1 + h)) - here) / h for h in (1e-3, 1e-4))
    size = np.abs(finest).max()
    assert size > 1e-2 * LARGEST
    assert np.abs(fine - finest).max() < 0.02 * size


@pytest.mark.parametrize(
    ("slug", "name", "value"), [("actuator-lag", "time_constant", 0.61), ("rate-limit", "rate", 3.7)]
)
def test_differences_match_the_continuous_motion(slug: str, name: str, value: float) -> None:
    def response(x: float) -> Array:
        moved = EFFECTS[slug].drive(applied(slug, **{name: x}), drive_of())
        return craft(moved.t, moved.channels["N"], 0.5, STAMPS)

    h = 1e-3 * value
    seen = (response(value + h) - response(value)) / h
    exact = [EXACT[slug](commands(), x, 0.5, STAMPS) for x in (value, value + h)]
    assert seen == pytest.approx((exact[1] - exact[0]) / h, abs=2e-3 * float(np.abs(seen).max()))


# -- the bilinear thruster, in the equations of motion


@pytest.mark.parametrize("gain", [1.0, "k_N", "-k_N"])
def test_thrust_is_lost_with_speed_for_any_input_gain(gain: float | str) -> None:
    known = {"k_N": 1.6} if isinstance(gain, str) else {}
    form = Form("plain", "", ("yaw",), ("N_rdot", "N_r"), known, {"N": (("N", gain),)}, coriolis=False)
    k = {1.0: 1.0, "k_N": 1.6, "-k_N": -1.6}[gain]
    result = data_summary(form)
    result = DataSummary(**{**{n: getattr(result, n) for n in DataSummary.__slots__}, "base": {**result.base, **known}})
    entry, loss = EFFECTS["advance-speed-loss"], 0.21
    own = EffectInstance(entry.slug, "N", {"loss": loss}, entry.constants("N", result))
    dead = EFFECTS["dead-zone"].drive(applied("dead-zone", width=0.5), drive_of())
    extended = form.freeing(*entry.derivatives(own))
    model = CoupledModel(extended, {"N_rdot": -2.0, "N_r": -0.4, **known, **entry.derivatives(own)})
    motion = model.simulate(dead.t, dead.channels, STAMPS)

    state, expected = np.array([0.0]), [0.0]
    for i in range(len(STAMPS) - 1):
        c = commands()[i]
        push = k * math.copysign(max(abs(c) - 0.5, 0.0), c)
        state = solve_ivp(
            lambda t, r, F=push: (F - loss * abs(F) * r - 0.4 * r) / 2.0,
            (STAMPS[i], STAMPS[i + 1]),
            state,
            rtol=1e-9,
            atol=1e-9,
        ).y[:, -1]
        expected.append(float(state[0]))
    assert motion.values["r"] == pytest.approx(expected, abs=1e-5 * max(np.abs(expected)))


def test_lost_thrust_has_an_axis_a_unit_and_a_plot() -> None:
    entry = EFFECTS["advance-speed-loss"]
    surge = Form("plain", "", ("surge",), ("X_udot", "X_u"), {}, {"X": (("X", 1.0),)}, coriolis=False)
    result = data_summary(surge)
    assert entry.places(result) == ("X",)
    assert entry.unit_of("loss", "X", result) == "s/m"
    assert entry.unit_of("loss", "N", data_summary()) == "s/rad"
    own = EffectInstance(entry.slug, "X", {"loss": 0.3}, entry.constants("X", result))
    assert entry.derivatives(own) == {"X_|X|u": -0.3}
    plot = entry.curve(own, result)
    assert plot is not None and plot.plain is not None
    assert plot.y == pytest.approx(LARGEST * (1.0 - 0.3 * plot.x))


@pytest.mark.parametrize("gain", [1.0, "k_N", "-k_N", "N_N"])
def test_steering_uses_the_simulated_speed_if_surge_is_simulated(gain: float | str) -> None:
    known = {gain.lstrip("-"): 1.6} if isinstance(gain, str) else {}
    form = Form(
        "plain",
        "",
        ("surge", "yaw"),
        ("X_udot", "X_u", "N_rdot", "N_r"),
        known,
        {"X": (("X", 1.0),), "N": (("N", gain),)},
        coriolis=False,
    )
    k = {1.0: 1.0, "-k_N": -1.6}.get(gain, 1.6)
    result = data_summary(form)
    base = {"X_udot": -3.0, "X_u": -1.5, "N_rdot": -2.0, "N_r": -0.4, **known}
    result = DataSummary(**{**{n: getattr(result, n) for n in DataSummary.__slots__}, "base": base})
    entry = EFFECTS["speed-dependent-steering"]
    own = EffectInstance(entry.slug, "N", {"share": 0.7}, entry.constants("N", result))
    push = 2.0 * np.sin(0.3 * STAMPS)
    drive = drive_of(X=push)
    assert entry.drive(own, drive) is drive
    added = entry.derivatives(own)
    values = {n: base.get(n, 0.0) + added.get(n, 0.0) for n in {**base, **added}}
    extended = form.freeing(*(n for n in added if n not in form.parameters))
    motion = CoupledModel(extended.freeing(*known), values).simulate(drive.t, drive.channels, STAMPS)

    state, expected, steer = np.zeros(2), [0.0], commands()
    for i in range(len(STAMPS) - 1):
        state = solve_ivp(
            lambda t, s, i=i: (
                (push[i] - 1.5 * s[0]) / 3.0,
                (k * steer[i] * (0.3 + 0.7 * (s[0] / own["U_ref"]) ** 2) - 0.4 * s[1]) / 2.0,
            ),
            (STAMPS[i], STAMPS[i + 1]),
            state,
            rtol=1e-9,
            atol=1e-9,
        ).y[:, -1]
        expected.append(float(state[1]))
    assert motion.values["r"] == pytest.approx(expected, abs=1e-5 * max(np.abs(expected)))


# -- entries of the catalogue


@pytest.mark.parametrize("slug", ACTUATORS)
def test_starts_lie_within_bounds_and_are_few(slug: str) -> None:
    entry = EFFECTS[slug]
    for tau in (0.05, 0.1, 1.0, 20.0, 1000.0):
        here = data_summary(tau=tau)
        starts, bounds = entry.starts("N", here), entry.bounds("N", here)
        assert 1 <= len(starts) <= 5
        for start in starts:
            assert set(start) == set(bounds) == {q.name for q in entry.parameters}
            assert all(bounds[n][0] <= v <= bounds[n][1] for n, v in start.items())


NEUTRAL = {
    "input-delay": {"delay": 0.0},
    "saturation": {"limit": LARGEST},
    "rate-limit": {"rate": 1e9},
    "actuator-lag": {"time_constant": 0.0},
    "backlash": {"width": 0.0},
    "dead-zone": {"width": 0.0},
    "quadratic-actuator": {"share": 0.0},
    "rudder-stall": {"angle": LARGEST, "drop": 1.0},
    "asymmetric-thrust": {"ratio": 1.0},
    "gain-drift": {"rate": 0.0},
    "speed-dependent-steering": {"share": 0.0},
}


@pytest.mark.parametrize("slug", NEUTRAL)
def test_a_neutral_value_changes_nothing(slug: str) -> None:
    moved = EFFECTS[slug].drive(applied(slug, **NEUTRAL[slug]), drive_of())
    at = 0.5 * (STAMPS[1:] + STAMPS[:-1])
    assert held(moved, at) == pytest.approx(held(drive_of(), at), abs=1e-9)


@pytest.mark.parametrize("slug", ACTUATORS)
def test_every_actuator_has_a_plot_and_a_description(slug: str) -> None:
    entry = EFFECTS[slug]
    own = EffectInstance(slug, "N", entry.starts("N", data_summary())[0], entry.constants("N", data_summary()))
    plot = entry.curve(own, data_summary())
    assert entry.family == "actuator"
    assert plot is not None and plot.plain is not None
    assert len(plot.x) == len(plot.y) == len(plot.plain)
    assert np.isfinite(plot.x).all() and np.isfinite(plot.y).all()
    assert np.abs(plot.y - plot.plain).max() > 0.01
    assert slug not in entry.mistaken_for and len(entry.mistaken_for) >= 2
    assert entry.meaning and entry.shown_by and entry.separated_by


def test_actuators_act_in_the_order_of_the_catalogue() -> None:
    assert [s for s in EFFECTS if s in ACTUATORS] == ACTUATORS


def test_places_are_where_the_runs_can_show_an_effect() -> None:
    twin = Form(
        "plain",
        "",
        ("surge", "yaw"),
        ("X_udot", "X_u", "N_rdot", "N_r"),
        {},
        {"X": (("X", 1.0),), "delta": (("N", 1.0),), "left": (("X", 1.0), ("N", 0.3)), "idle": (("N", 1.0),)},
        coriolis=False,
    )
    here = data_summary(twin)
    extent = {**here.extent, "X": (0.0, 3.0), "delta": (-0.4, 0.4), "left": (-1.0, 1.0), "idle": (0.0, 0.0)}
    result = DataSummary(
        **{
            **{n: getattr(here, n) for n in DataSummary.__slots__},
            "extent": extent,
            "inputs": {"X": "N", "delta": "rad", "left": "N", "idle": "1"},
            "amplitude": {"X": 3.0, "delta": 0.4, "left": 1.0, "idle": 0.0},
        }
    )
    assert EFFECTS["saturation"].places(result) == ("X", "delta", "left")
    assert EFFECTS["asymmetric-thrust"].places(result) == ("delta", "left")
    assert EFFECTS["rudder-stall"].places(result) == ("delta", "left")
    assert EFFECTS["speed-dependent-steering"].places(result) == ("delta", "left")
    assert EFFECTS["advance-speed-loss"].places(result) == ("X",)
    steady = DataSummary(
        **{**{n: getattr(result, n) for n in DataSummary.__slots__}, "extent": {**extent, "u": (0.98, 1.02)}}
    )
    assert EFFECTS["speed-dependent-steering"].places(steady) == ()
    blind = DataSummary(**{**{n: getattr(result, n) for n in DataSummary.__slots__}, "channels": frozenset({"psi"})})
    assert EFFECTS["speed-dependent-steering"].places(blind) == ()


@pytest.mark.parametrize("tau", [0.05, 0.6, 3.0, 100.0])
def test_the_quickest_craft_is_estimated_from_the_base_with_a_margin(tau: float) -> None:
    assert quickest(data_summary(tau=tau)) == pytest.approx(min(max(tau / 3.0, 0.1), 5.0))
    without = DataSummary(**{**{n: getattr(data_summary(tau=tau), n) for n in DataSummary.__slots__}, "base": {}})
    assert quickest(without) == quickest(data_summary(tau=tau))


def test_effects_are_described_in_words_and_not_by_slug() -> None:
    assert effect_at(EffectInstance("quadratic-actuator", "N", {})) == "quadratic thrust curve (N)"
    assert effect_words("N_u") == "velocity product (N_u)"
    assert not [slug for slug in EFFECTS if "-" in effect_words(slug)]
