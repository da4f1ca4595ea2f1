"""Wrong clocks, units, signs and plugs: the laws, and where they are looked for."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from gcs_autotune.effects import EFFECTS, DataSummary, Drive, EffectInstance, ExtendedModel, Observed, passage_of
from gcs_autotune.models import CoupledModel, form_from

SLUGS = ("time-scale", "time-offset", "unit-error", "sign-error", "channel-swap")
UNITS = {"psi": "rad", "r": "rad/s", "u": "m/s", "v": "m/s", "x": "m", "y": "m"}
T = np.linspace(10.0, 14.0, 41)


def yaw(inputs: Mapping[str, Mapping[str, float | str]] | None = None, **more: object) -> dict[str, object]:
    free = ["N_rdot", "N_r", *(["N_delta"] if inputs and "delta" in inputs else [])]
    return {"name": "yaw", "dofs": ["yaw"], "free": free, "inputs": inputs or {"N": {"N": 1.0}}} | more


PLANAR = {
    "name": "plane",
    "dofs": ["surge", "sway", "yaw"],
    "free": ["X_udot", "X_u", "Y_vdot", "Y_v", "N_rdot", "N_r"],
    "inputs": {"X": {"X": 1.0}, "N": {"N": 1.0}},
    "coriolis": False,
}


def data_summary(form: dict[str, object], *signals: str, runs: tuple[str, ...] = ("a",)) -> DataSummary:
    made = form_from(form, "test")
    force = {"X": "N", "N": "N m", "delta": "rad", "M1": "N m"}
    return DataSummary(
        form=made,
        inputs={c: force[c] for c in made.inputs},
        signals={s: UNITS[s] for s in signals},
        amplitude=dict.fromkeys(made.inputs, 2.0),
        spread=dict.fromkeys(signals, 0.5),
        level=dict.fromkeys(signals, 0.01),
        channels=frozenset((*made.inputs, *signals)),
        interval=0.1,
        time_constant=2.0,
        duration=60.0,
        runs=runs,
    )


def seen(**signals: np.ndarray) -> Observed:
    return Observed(T, signals, 10.0, "b")


@pytest.mark.parametrize("slug", SLUGS)
def test_starts_lie_within_the_bounds(slug: str) -> None:
    effect = EFFECTS[slug]
    about = data_summary(PLANAR, "u", "v", "r", "psi", "x", "y")
    assert effect.places(about)
    for place in effect.places(about):
        bounds = effect.bounds(place, about)
        starts = effect.starts(place, about)
        assert starts
        for start in starts:
            assert set(start) == {q.name for q in effect.parameters}
            assert all(bounds[n][0] <= v <= bounds[n][1] for n, v in start.items())


def test_data_errors_are_searched_first() -> None:
    assert tuple(EFFECTS)[: len(SLUGS)] == SLUGS


def test_a_fast_clock_is_corrected_about_the_first_stamp() -> None:
    own = EffectInstance("time-scale", "t", {"factor": 1.25})
    true = EFFECTS["time-scale"].retime(own, T, 10.0, inputs=False)
    assert true[0] == 10.0
    assert true[-1] == pytest.approx(10.0 + 4.0 / 1.25)
    np.testing.assert_array_equal(true, EFFECTS["time-scale"].retime(own, T, 10.0, inputs=True))


def test_a_wrong_clock_is_visible_only_with_a_position_and_its_velocity() -> None:
    effect = EFFECTS["time-scale"]
    assert effect.places(data_summary(yaw(), "psi", "r")) == ("t",)
    assert effect.places(data_summary(yaw(), "r")) == ()
    assert effect.places(data_summary(PLANAR, "u", "r", "psi", "x", "y")) == ("t",)


def craft(effects: tuple[EffectInstance, ...], t_in: np.ndarray, stamps: np.ndarray) -> dict[str, np.ndarray]:
    form = form_from(yaw(), "test")
    model = ExtendedModel(CoupledModel(form, {"N_rdot": -1.0, "N_r": -0.5}), effects)
    command = np.where(t_in >= 2.0, 1.0, 0.0) - 2.0 * (t_in >= 5.0)
    found = model.predict(passage_of("a", t_in, {"N": command}, {"psi": stamps, "r": stamps}), {})
    assert found is not None
    return found


@pytest.mark.parametrize("offset", [-0.7, 0.4])
def test_signals_stamped_late_show_the_motion_of_earlier_commands(offset: float) -> None:
    t = np.arange(0.0, 10.0, 0.1)
    late = craft((EffectInstance("time-offset", "t", {"offset": offset}),), t, t)
    # By hand: the response of r' = (N - 0.5 r), command jumps moved by the offset in the signals' clock.
    r, dt, fine = 0.0, 1e-3, []
    for k in range(int(10.0 / dt)):
        now = k * dt - offset
        r += dt * ((1.0 if now >= 2.0 else 0.0) - (2.0 if now >= 5.0 else 0.0) - 0.5 * r)
        fine.append(r)
    np.testing.assert_allclose(late["r"][1:], np.array(fine)[99::100][: len(t) - 1], atol=3e-3)


def test_a_file_with_a_fast_clock_moves_too_slowly_for_its_rates() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    plain = craft((), t, t)
    fast = craft((EffectInstance("time-scale", "t", {"factor": 2.0}),), 2.0 * t, 2.0 * t)
    # The same motion, written on another clock; the command of craft() jumps at other places, so compare kinematics.
    turned = np.gradient(fast["psi"], 2.0 * t)[5:-5]
    swing = np.ptp(fast["r"])
    assert np.max(np.abs(turned - 0.5 * fast["r"][5:-5])) < 0.03 * swing
    assert np.max(np.abs(np.gradient(plain["psi"], t)[5:-5] - plain["r"][5:-5])) < 0.06 * np.ptp(plain["r"])


def test_a_unit_mistake_scales_a_signal_and_unscales_a_command() -> None:
    effect = EFFECTS["unit-error"]
    own = EffectInstance("unit-error", "r", {"factor": 180.0 / math.pi})
    shown = effect.observe(own, seen(r=np.full(41, math.pi), psi=T))
    np.testing.assert_allclose(shown.signals["r"], 180.0)
    np.testing.assert_array_equal(shown.signals["psi"], T)
    commands = Drive(T, {"N": np.full(41, 98.0665)}, 10.0)
    true = effect.drive(EffectInstance("unit-error", "N", {"factor": 9.80665}), commands)
    np.testing.assert_allclose(true.channels["N"], 10.0)


def test_the_factor_of_a_unit_mistake_is_chosen_and_not_fitted() -> None:
    effect = EFFECTS["unit-error"]
    assert effect.fixed == ("factor",)
    about = data_summary(yaw(), "psi", "r")
    factors = [s["factor"] for s in effect.starts("psi", about)]
    assert any(f == pytest.approx(57.29578, rel=1e-6) for f in factors)
    assert all(any(f * g == pytest.approx(1.0) for g in factors) for f in factors)


def test_unit_mistakes_are_searched_only_where_the_data_can_show_them() -> None:
    effect = EFFECTS["unit-error"]
    assert effect.places(data_summary(yaw(), "r")) == ()
    assert effect.places(data_summary(yaw(), "psi", "r")) == ("psi", "r")
    # With the inertia known the moment's unit matters, and so does a lone gyro's.
    weighed = yaw(free=["N_r"], known={"I_z": 3.0, "N_rdot": -1.0})
    assert effect.places(data_summary(weighed, "r")) == ("r", "N")
    two = yaw({"N": {"N": 1.0}, "M1": {"N": 0.3}})
    assert effect.places(data_summary(two, "r")) == ("N", "M1")
    assert set(effect.places(data_summary(PLANAR, "u", "v", "r", "psi", "x", "y"))) == {"u", "v", "r", "psi", "x", "y"}
    assert effect.places(data_summary(PLANAR, "u", "v", "r")) == ()


def test_a_wrong_sign_applies_to_every_run_or_to_one() -> None:
    effect = EFFECTS["sign-error"]
    r = np.sin(T)
    np.testing.assert_array_equal(effect.observe(EffectInstance("sign-error", "r", {}), seen(r=r)).signals["r"], -r)
    np.testing.assert_array_equal(effect.observe(EffectInstance("sign-error", "r@b", {}), seen(r=r)).signals["r"], -r)
    np.testing.assert_array_equal(effect.observe(EffectInstance("sign-error", "r@a", {}), seen(r=r)).signals["r"], r)
    drive = Drive(T, {"N": r}, 10.0, run="run+1@dock")
    for place, sign in (("N", -1.0), ("N@run+1@dock", -1.0), ("N@run", 1.0), ("r", 1.0)):
        found = effect.drive(EffectInstance("sign-error", place, {}), drive).channels["N"]
        np.testing.assert_array_equal(found, sign * r)


def test_a_rudder_sign_is_searched_only_as_a_difference_between_runs() -> None:
    effect = EFFECTS["sign-error"]
    rudder = yaw({"delta": {"N": "N_delta"}})
    assert effect.places(data_summary(rudder, "psi", "r")) == ("psi", "r")
    several = effect.places(data_summary(rudder, "r", runs=("a", "b")))
    assert several == ("r", "r@a", "r@b", "delta@a", "delta@b")
    assert "N" in effect.places(data_summary(yaw(), "r"))


def test_exchanged_columns_are_exchanged_back() -> None:
    effect = EFFECTS["channel-swap"]
    swapped = effect.observe(EffectInstance("channel-swap", "u+v", {}), seen(u=T, v=-T, r=0.0 * T))
    np.testing.assert_array_equal(swapped.signals["u"], -T)
    np.testing.assert_array_equal(swapped.signals["v"], T)
    drive = effect.drive(EffectInstance("channel-swap", "X+N", {}), Drive(T, {"X": T, "N": -T}, 10.0))
    np.testing.assert_array_equal(drive.channels["X"], -T)
    untouched = effect.drive(EffectInstance("channel-swap", "u+v", {}), drive)
    np.testing.assert_array_equal(untouched.channels["X"], -T)


def test_only_columns_of_one_kind_are_considered_exchanged() -> None:
    effect = EFFECTS["channel-swap"]
    assert effect.places(data_summary(PLANAR, "u", "v", "r", "psi", "x", "y")) == ("u+v", "x+y", "X+N")
    assert effect.places(data_summary(yaw(), "psi", "r")) == ()
    pods = yaw({"N": {"N": "k_1"}, "M1": {"N": "k_2"}}, free=["N_rdot", "N_r", "k_1", "k_2"])
    assert effect.places(data_summary(pods, "r")) == ()
