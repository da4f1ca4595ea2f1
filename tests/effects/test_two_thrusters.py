"""Two thrusters of one kind: an effect of both is one cause, and what nothing distinguishes has one name."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.diagnose import diagnose
from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance
from gcs_autotune.identify.problems import data_summary_of, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.trial import Channel, Trial

WEAK = 0.75
"""Thrust of a command astern as a fraction of that ahead."""


def steps(seed: int, *, opposite: float = 0.0) -> Trial:
    """A boat driven by two thrusters, both weaker astern, that hardly coasts: steps of 4 s both ways."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 80.0, 0.2)
    ahead = 20.0 * np.repeat(rng.uniform(-1.0, 1.0, 20), 20)
    differs = opposite * np.repeat(rng.uniform(-1.0, 1.0, 20), 20)
    left, right = ahead + differs, ahead - differs
    u = np.zeros(len(t))
    push = sum(np.where(f < 0.0, WEAK * f, f) for f in (left, right))
    for k in range(len(t) - 1):
        kept = np.exp(-0.2 / 1.5)
        u[k + 1] = kept * u[k] + (1.0 - kept) * push[k] / 25.0
    u += 0.01 * rng.standard_normal(len(t))
    channels = {"u": Channel("u", "m/s", t, u)}
    for name, values in (("force_left", left), ("force_right", right)):
        channels[name] = Channel(name, "N", t, values)
    return Trial(f"run{seed}", channels)


def summary(*runs: Trial) -> DataSummary:
    form = plain_form(runs, "surge")
    return data_summary_of(form, prepare_as_recorded(runs, form, None)[0])


def test_two_thrusters_with_equal_commands_are_only_analysed_together() -> None:
    alike, apart = summary(steps(1)), summary(steps(1, opposite=10.0))
    assert EFFECTS["asymmetric-thrust"].places(alike) == ("force_left+force_right",)
    assert set(EFFECTS["asymmetric-thrust"].places(apart)) == {"force_left", "force_right", "force_left+force_right"}


def test_a_thruster_is_not_a_candidate_for_rudder_stall() -> None:
    run = steps(1, opposite=10.0)
    turning = Trial("turns", {**run.channels, "r": Channel("r", "rad/s", run["u"].t, 0.1 * run["u"].values)})
    form = plain_form([turning], "yaw")
    data = data_summary_of(form, prepare_as_recorded([turning], form, None)[0])
    assert EFFECTS["rudder-stall"].places(data) == ()
    assert EFFECTS["saturation"].places(data) == ("force_left", "force_right", "force_left+force_right")


def test_a_curve_of_both_thrusters_is_applied_to_each_command() -> None:
    t = np.array([0.0, 1.0])
    drive = Drive(t, {"force_left": np.array([-2.0, 1.0]), "force_right": np.array([3.0, -4.0])}, 0.0)
    effect = EffectInstance("asymmetric-thrust", "force_left+force_right", {"ratio": 0.5})
    bent = EFFECTS["asymmetric-thrust"].drive(effect, drive).channels
    np.testing.assert_array_equal(bent["force_left"], [-1.0, 1.0])
    np.testing.assert_array_equal(bent["force_right"], [3.0, -2.0])


def test_two_thrusters_weak_astern_are_identified_together_with_their_ratio() -> None:
    result = diagnose([steps(1), steps(2)], dof="surge", effects=["asymmetric-thrust", "dead-zone", "quadratic-drag"])
    (cause,) = result.causes
    assert (cause.effect.slug, cause.effect.place) == ("asymmetric-thrust", "force_left+force_right")
    assert abs(cause.effect["ratio"] - WEAK) < 0.03


SLOW = {
    "actuator-lag": {"time_constant": 0.8},
    "input-delay": {"delay": 0.7},
    "backlash": {"width": 10.0},
    "rate-limit": {"rate": 15.0},
    "gain-drift": {"rate": 0.004},
    "advance-speed-loss": {"loss": 0.3},
}
"""Effects that both thrusters have, and how much of them."""


def late(slug: str, f: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What a thruster with one of :data:`SLOW` gives for the commands *f* held from the stamps *t* on."""
    (value,), dt = SLOW[slug].values(), t[1] - t[0]
    if slug == "input-delay":
        return np.r_[np.full(round(value / dt), f[0]), f[: -round(value / dt)]]
    if slug == "gain-drift":
        return f * (1.0 - value * t)
    acting, now = np.empty_like(f), f[0]
    for k, command in enumerate(f):
        if slug == "actuator-lag":
            now = command + (now - command) * np.exp(-dt / value)
        elif slug == "rate-limit":
            now += np.clip(command - now, -value * dt, value * dt)
        else:
            now = min(max(now, command - 0.5 * value), command + 0.5 * value)
        acting[k] = now
    return acting


def slow_steps(slug: str, seed: int, opposite: float) -> Trial:
    """Steps of 4 s both ways of a boat that coasts 3 s; thrust is calculated 50 times a second, recorded 5 times."""
    rng, dt = np.random.default_rng(seed), 0.02
    t = np.arange(0.0, 80.0, dt)
    ahead, differs = (np.repeat(rng.uniform(-size, size, 20), 200) for size in (20.0, opposite))
    commands = {"force_left": ahead + differs, "force_right": ahead - differs}
    lost = SLOW[slug].get("loss", 0.0)
    forces = list(commands.values()) if lost else [late(slug, f, t) for f in commands.values()]
    push, drop = sum(forces), lost * sum(np.abs(f) for f in forces)
    u = np.zeros(len(t))
    for k in range(len(t) - 1):
        u[k + 1] = u[k] + dt / 3.0 * ((push[k] - drop[k] * u[k]) / 25.0 - u[k])
    seen = u[::10] + 0.01 * rng.standard_normal(len(t[::10]))
    channels = {"u": Channel("u", "m/s", t[::10], seen)}
    for name, values in commands.items():
        channels[name] = Channel(name, "N", t[::10], values[::10])
    return Trial(f"run{seed}", channels)


@pytest.mark.parametrize("opposite", [0.0, 10.0], ids=["commanded alike", "commanded apart"])
@pytest.mark.parametrize("slug", SLOW)
def test_an_effect_of_both_thrusters_is_one_cause(slug: str, opposite: float) -> None:
    result = diagnose([slow_steps(slug, seed, opposite) for seed in (1, 2)], dof="surge", effects=list(SLOW))
    (cause,) = result.causes
    assert (cause.effect.slug, cause.effect.place) == (slug, "force_left+force_right")
    assert dict(cause.effect.values) == pytest.approx(SLOW[slug], rel=0.1)


def turns(seed: int, *, astern: float, lag: float = 0.0) -> Trial:
    """A moving boat that two thrusters turn, at 10 Hz: two sizes of turn, the larger above the throttle."""
    rng, dt, throttle = np.random.default_rng(seed), 0.01, 0.4
    t = np.arange(0.0, 60.0, dt)
    N = np.repeat(rng.permutation(np.tile([0.3, -0.3, 0.45, -0.45], 5)), 300)
    inner = throttle - np.abs(N)
    acting = np.sign(N) * 0.5 * (throttle + np.abs(N) - np.where(inner < 0.0, astern * inner, inner))
    r, now = np.zeros(len(t)), acting[0]
    for k in range(len(t) - 1):
        now = acting[k] + (now - acting[k]) * np.exp(-dt / lag) if lag else acting[k]
        r[k + 1] = r[k] + dt * (now - r[k])
    columns = {"r": ("rad/s", r[::10] + 0.0003 * rng.standard_normal(len(t[::10]))), "N": ("1", N[::10])}
    columns["X"] = ("1", np.full(len(t[::10]), throttle))
    return Trial(f"run{seed}", {n: Channel(n, unit, t[::10], values) for n, (unit, values) in columns.items()})


def test_weak_thrust_astern_is_preferred_to_a_limit_in_hard_turns() -> None:
    runs = [turns(seed, astern=0.5) for seed in (1, 2)]
    result = diagnose(
        runs, dof="yaw", effects=["saturation", "quadratic-actuator", "asymmetric-thrust", "quadratic-drag"]
    )
    (cause,) = result.causes
    assert (cause.effect.slug, cause.effect.place) == ("asymmetric-thrust", "N+X")
    assert cause.effect["ratio"] == pytest.approx(0.5, abs=0.05)
    assert any({"saturation", "asymmetric-thrust"} <= set(group) for group in result.indistinguishable)


def test_a_lag_below_half_a_sample_is_not_a_cause() -> None:
    runs = [turns(seed, astern=1.0, lag=0.03) for seed in (1, 2)]
    result = diagnose(runs, dof="yaw", effects=["actuator-lag", "input-delay", "measurement-delay", "time-offset"])
    assert result.causes == ()
    slower = [turns(seed, astern=1.0, lag=0.12) for seed in (1, 2)]
    (cause,) = diagnose(slower, dof="yaw", effects=["actuator-lag", "input-delay", "time-offset"]).causes
    assert cause.effect.slug == "actuator-lag"
