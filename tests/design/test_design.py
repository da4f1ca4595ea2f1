"""From a model to a proposal."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_autotune.design import LAWS, Change, Proposal, Scenario, Spec, design, is_better, step_metrics
from gcs_autotune.design.plant import sample_region
from gcs_autotune.errors import NoGainsMeetSpec, ParameterMissing, UnknownName, UsageError
from gcs_autotune.firmware import FIRMWARE, Axis
from gcs_autotune.models import SingleDof

from .crafts import (
    CHARLIE,
    CRAFTS,
    DEFAULTS,
    ROVER_HEADING,
    SUB_DEPTH,
    SUB_HEADING,
    VIDEORAY_HEAVE,
    boat,
    heave,
    present,
    surge,
    uncertain,
    yaw,
)

pytestmark = pytest.mark.usefixtures("briefly")

FALCON = yaw(0.2, 0.75, 0.025)


def propose(name: str, **spec: float | str) -> Proposal:
    model, axis, base_spec = CRAFTS[name]
    return design(model, uncertain(model), axis, present(axis), replace(base_spec, **spec))


def gains_of(axis: Axis, proposal: Proposal) -> dict[str, float]:
    return {**present(axis), **proposal.new}


class Proposals(dict[str, Proposal]):
    """Each made when first asked for."""

    def __missing__(self, name: str) -> Proposal:
        self[name] = propose(name)
        return self[name]


@pytest.fixture(scope="module")
def proposals() -> Proposals:
    return Proposals()


QUICK = ("charlie", "falcon heave")
EVERY = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CRAFTS]


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_the_predicted_step_is_better_than_with_the_firmwares_defaults(
    proposals: dict[str, Proposal], name: str
) -> None:
    proposal = proposals[name]
    verdict = is_better(proposal.before.metrics, proposal.after.metrics)
    assert verdict.better, verdict.reasons


@pytest.mark.parametrize("name", EVERY)
def test_margins_hold_over_the_region_of_the_identified_parameters(proposals: dict[str, Proposal], name: str) -> None:
    proposal = proposals[name]
    low = proposal.worst_margins
    assert low.stable
    assert low.gain >= 2.0
    assert math.degrees(low.phase) >= 30.0
    specified = low.gain >= 2.5 and math.degrees(low.phase) >= 45.0
    assert specified or any("below the specification" in note for note in proposal.notes)
    assert proposal.margins.gain >= low.gain
    assert proposal.bound[0] < proposal.bound[1]


@pytest.mark.parametrize("name", EVERY)
def test_the_step_is_better_for_every_craft_in_the_region(proposals: dict[str, Proposal], name: str) -> None:
    model, axis, spec = CRAFTS[name]
    proposal, law = proposals[name], LAWS[axis.law]
    scenario = Scenario(float(proposal.after.target[-1]), float(proposal.after.t[-1]))
    samples = sample_region(model, uncertain(model)).samples
    assert len(samples) > 12
    for sample in samples:
        found = []
        for gains in (present(axis), gains_of(axis, proposal)):
            m = law.simulate(sample, gains, scenario, spec.speed, 0.0)
            found.append(step_metrics(m.t, np.full_like(m.t, scenario.step), m.position, m.output))
        assert found[1].itae < found[0].itae


@pytest.mark.parametrize("name", EVERY)
def test_gains_stay_in_their_documented_ranges_and_survive_float32(proposals: dict[str, Proposal], name: str) -> None:
    assert proposals[name].changes
    for change in proposals[name].changes:
        assert change.low <= change.new <= change.high
        assert float(f"{np.float32(change.new):.4g}") == pytest.approx(change.new, rel=1e-6)
        assert change.reason
        assert change.at_limit == (change.new != 0.0 and change.new in (change.low, change.high))
        assert change.at_limit == (", limited to the documented " in change.reason)


def test_a_gain_of_zero_is_off_and_not_at_its_limit() -> None:
    off, least = (Change("ATC_RAT_YAW_D", 0.1, new, new, 0.2, "damps") for new in (0.0, 0.01))
    assert not off.at_limit
    assert least.at_limit


@pytest.mark.slow
@pytest.mark.parametrize("name", ["videoray yaw", "falcon yaw", "automarine"])
def test_the_sub_is_also_better_with_an_unshaped_target(proposals: dict[str, Proposal], name: str) -> None:
    model, axis, spec = CRAFTS[name]
    jumps = {"ATC_RATE_FF_ENAB": 0.0, "ATC_SLEW_YAW": 1e6}
    proposal, law = proposals[name], LAWS[axis.law]
    scenario = Scenario(float(proposal.after.target[-1]), float(proposal.after.t[-1]))
    found = []
    for gains in (present(axis), gains_of(axis, proposal)):
        m = law.simulate(model, {**gains, **jumps}, scenario, spec.speed, 0.0)
        found.append(step_metrics(m.t, np.full_like(m.t, scenario.step), m.position, m.output))
    assert is_better(found[0], found[1]).better


@pytest.mark.slow
@pytest.mark.parametrize("name", ["charlie", "falcon yaw", "falcon heave"])
def test_a_faster_specification_never_gives_a_slower_step(proposals: dict[str, Proposal], name: str) -> None:
    base = proposals[name].wanted.omega_0
    rises = []
    for factor in (0.5, 0.7, 1.0):
        try:
            rises.append(propose(name, omega_0=factor * base, phase_margin=math.radians(30.0)).after.metrics.rise)
        except NoGainsMeetSpec:
            continue
    assert len(rises) >= 2
    assert all(later <= 1.05 * earlier for earlier, later in pairwise(rises))


def test_a_feasible_settling_time_is_met() -> None:
    proposal = propose("falcon heave", settling_time=5.0)
    assert proposal.after.metrics.settling == pytest.approx(5.0, rel=0.35)
    assert proposal.wanted.kind == "bessel"


@pytest.mark.slow
def test_a_requested_butterworth_model_is_used() -> None:
    assert propose("falcon yaw", kind="butterworth").wanted.kind == "butterworth"


@pytest.mark.slow
def test_the_same_inputs_give_the_same_proposal(proposals: dict[str, Proposal]) -> None:
    assert propose("videoray heave").to_dict() == proposals["videoray heave"].to_dict()


@pytest.mark.slow
def test_a_biased_craft_gets_an_integral_gain(proposals: dict[str, Proposal]) -> None:
    for name in ("charlie trimmed off", "falcon heave", "videoray heave"):
        _, axis, _ = CRAFTS[name]
        law = LAWS[axis.law]
        assert gains_of(axis, proposals[name])[law.integral] > 0.0


@pytest.mark.slow
def test_a_proposal_is_plain_json(proposals: dict[str, Proposal]) -> None:
    texts = [json.dumps(proposals[name].to_dict()) for name in CRAFTS]
    assert not any("Infinity" in text for text in texts)


@pytest.mark.slow
def test_designing_again_from_the_new_gains_soon_changes_nothing() -> None:
    model, axis, spec = CRAFTS["falcon yaw"]
    gains = present(axis)
    for _ in range(3):
        proposal = design(model, uncertain(model), axis, gains, spec)
        if not proposal.changes:
            break
        gains.update(proposal.new)
    assert proposal.changes == ()
    assert any("are better than the present ones" in note for note in proposal.notes)
    assert proposal.after.metrics == proposal.before.metrics


@pytest.mark.slow
def test_present_gains_outside_their_range_are_reported_and_replaced() -> None:
    model, axis, spec = CRAFTS["bluerov heave"]
    gains = {**present(axis), "PSC_ACCZ_P": 2.0, "PSC_ACCZ_I": 4.0, "PSC_ACCZ_FF": 0.75}
    proposal = design(model, uncertain(model), axis, gains, spec)
    assert sum("outside its range" in note for note in proposal.notes) == 3
    assert all(c.low <= c.new <= c.high for c in proposal.changes)


def test_a_gain_at_its_limit_in_float32_is_not_reported_as_outside() -> None:
    model, axis, spec = CRAFTS["falcon yaw"]
    gains = {**present(axis), "ATC_RAT_YAW_I": float(np.float32(0.05)), "ATC_RAT_YAW_P": float(np.float32(0.18))}
    assert gains["ATC_RAT_YAW_I"] > 0.05
    proposal = design(model, uncertain(model), axis, gains, spec)
    assert not any("outside" in note for note in proposal.notes)


def test_a_present_derivative_gain_is_removed_with_a_reason() -> None:
    model, axis, spec = CRAFTS["falcon yaw"]
    gains = {**present(axis), "ATC_RAT_YAW_D": 0.01}
    change = next(
        c for c in design(model, uncertain(model), axis, gains, spec).changes if c.parameter == "ATC_RAT_YAW_D"
    )
    assert change.new == 0.0
    assert "no lag" in change.reason


@pytest.mark.slow
def test_units_do_not_matter_with_a_known_full_scale() -> None:
    physical = SingleDof("yaw", "N m", 80.0, 300.0, 10.0)
    by_unit = design(physical, uncertain(physical), SUB_HEADING, present(SUB_HEADING), Spec(full_scale=400.0))
    covariance = uncertain(physical) / 400.0**2
    by_fraction = design(FALCON, covariance, SUB_HEADING, present(SUB_HEADING), Spec())
    assert by_unit.new == pytest.approx(by_fraction.new, rel=1e-3)


@pytest.mark.slow
def test_a_rudder_of_reversed_sign_is_a_full_scale_of_reversed_sign() -> None:
    rudder = SingleDof("yaw", "rad", -7.4, -2.4)
    spec = Spec(speed=1.1, full_scale=-0.52)
    assert design(rudder, np.zeros((5, 5)), ROVER_HEADING, present(ROVER_HEADING), spec).changes


@pytest.mark.slow
def test_a_delay_of_the_link_does_not_slow_the_loop() -> None:
    late, known = propose("videoray yaw late"), propose("videoray yaw late", link_delay=0.2)
    assert known.wanted.omega_0 > late.wanted.omega_0
    assert any("link delay" in note for note in late.notes)


@pytest.mark.slow
def test_more_noise_gives_a_less_stiff_controller() -> None:
    calm, noisy = propose("bluerov yaw"), propose("bluerov yaw", noise_std=math.radians(6.0))
    stiffness = [p.new["ATC_RAT_YAW_P"] * p.new["ATC_ANG_YAW_P"] for p in (calm, noisy)]
    assert stiffness[1] < stiffness[0]


def test_the_rovers_notes_state_the_speeds_at_which_the_gains_are_valid(proposals: dict[str, Proposal]) -> None:
    (note,) = [n for n in proposals["charlie"].notes if "1.10 m/s" in n and "MOT_SPD_SCA_BASE" in n]
    assert "The chosen value may differ: the design chooses all gains together" in note
    assert any("freezes its integral" in note for note in proposals["charlie slow"].notes)
    assert any("unstable" in note for note in proposals["charlie"].notes)


@pytest.mark.slow
def test_missing_context_uses_the_firmwares_defaults() -> None:
    law = LAWS["rover-heading"]
    model, axis, spec = CRAFTS["charlie"]
    result = design(model, uncertain(model), axis, {**present(axis), **law.defaults}, spec)
    assert result.new == propose("charlie").new


@pytest.mark.parametrize(
    ("model", "axis", "spec", "error", "match"),
    [
        (yaw(-0.2, -0.75), SUB_HEADING, Spec(), NoGainsMeetSpec, "against its output"),
        (yaw(0.2, 0.75, 0.0, 0.95), SUB_HEADING, Spec(), NoGainsMeetSpec, "a constant force"),
        (yaw(0.2, 0.75, 0.0, 0.85), SUB_HEADING, Spec(), NoGainsMeetSpec, "[Tt]rim the craft"),
        (yaw(math.nan, 0.75), SUB_HEADING, Spec(), NoGainsMeetSpec, "not finite"),
        (yaw(0.2, 0.75, 0.0, 0.0, -0.1), SUB_HEADING, Spec(), NoGainsMeetSpec, "negative delay"),
        (CHARLIE, ROVER_HEADING, Spec(speed=1.1, omega_0=4.0), NoGainsMeetSpec, "Try a longer"),
        (VIDEORAY_HEAVE, SUB_DEPTH, Spec(omega_0=1.0, phase_margin=1.5), NoGainsMeetSpec, "phase margin"),
        (CHARLIE, ROVER_HEADING, Spec(), UsageError, "speed"),
        (heave(0.4, 0.7), SUB_HEADING, Spec(), UsageError, "needs a model of yaw"),
        (SingleDof("yaw", "N m", 80.0, 300.0), SUB_HEADING, Spec(), UsageError, "full scale"),
        (FALCON, SUB_HEADING, Spec(full_scale=0.0), UsageError, "full scale"),
        (FALCON, replace(SUB_HEADING, law="sub-headng"), Spec(), UnknownName, "sub-heading"),
    ],
)
def test_an_impossible_design_is_rejected_with_a_reason(
    model: SingleDof, axis: Axis, spec: Spec, error: type[Exception], match: str
) -> None:
    gains = present(axis) if axis.law in DEFAULTS else present(SUB_HEADING)
    with pytest.raises(error, match=match):
        design(model, np.diag([1e-6, 1e-6, 0.0, 0.0, 0.0]), axis, gains, spec)


def test_a_gain_that_cannot_be_restored_stops_the_design() -> None:
    gains = present(SUB_HEADING)
    del gains["ATC_RAT_YAW_I"]
    with pytest.raises(ParameterMissing, match="ATC_RAT_YAW_I"):
        design(FALCON, np.zeros((5, 5)), SUB_HEADING, gains)


@pytest.mark.parametrize("shape", [(4, 4), (5, 5)])
def test_an_unusable_covariance_is_a_usage_error(shape: tuple[int, int]) -> None:
    with pytest.raises(UsageError, match="covariance"):
        design(FALCON, np.full(shape, np.nan), SUB_HEADING, present(SUB_HEADING))


def test_a_model_without_uncertainty_is_designed_for_with_a_note() -> None:
    proposal = design(FALCON, np.zeros((5, 5)), SUB_HEADING, present(SUB_HEADING))
    assert proposal.worst_margins == proposal.margins
    assert any("has no uncertainty" in note for note in proposal.notes)


@pytest.mark.parametrize(
    "wrong",
    [
        {"omega_0": 1.0, "settling_time": 2.0},
        {"omega_0": -1.0},
        {"step": 0.0},
        {"noise_std": -1.0},
        {"loop_delay": math.nan},
        {"speed": math.inf},
    ],
)
def test_an_invalid_specification_is_rejected(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        Spec(**wrong)


@pytest.mark.slow
def test_every_axis_of_every_firmware_can_be_designed_for() -> None:
    tilts = {dof: SingleDof(dof, "1", 0.4, 0.3, 0.0, 0.0, 0.05) for dof in ("roll", "pitch")}
    models = {"yaw": boat(1.0, 0.5), "heave": heave(0.3, 0.3, 0.5), "surge": surge(1.0, 0.1, 0.05), **tilts}
    for firmware in FIRMWARE.values():
        for axis in firmware.axes.values():
            model = models[axis.dof]
            assert design(model, uncertain(model), axis, present(axis), Spec(speed=2.0)).changes


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    time_constant=st.floats(0.5, 8.0),
    gain=st.floats(0.2, 2.0),
    speed=st.floats(0.8, 6.0),
    delta=st.floats(-0.1, 0.1),
    delay=st.floats(0.0, 0.3),
)
def test_any_boat_gets_a_stable_loop_inside_the_ranges_or_advice(
    time_constant: float, gain: float, speed: float, delta: float, delay: float
) -> None:
    model = boat(time_constant, gain, delta, delay)
    try:
        proposal = design(model, uncertain(model), ROVER_HEADING, present(ROVER_HEADING), Spec(speed=speed))
    except NoGainsMeetSpec as error:
        assert "Try" in str(error)
        return
    assert proposal.worst_margins.stable
    assert all(c.low <= c.new <= c.high for c in proposal.changes)
    assert np.max(np.abs(proposal.after.position)) < 2.0


@pytest.mark.slow
@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    alpha=st.floats(0.05, 1.0),
    beta=st.floats(0.0, 1.0),
    quadratic=st.floats(0.0, 2.0),
    delta=st.floats(-0.15, 0.15),
    delay=st.floats(0.0, 0.2),
)
def test_any_rov_gets_a_stable_depth_loop_inside_the_ranges_or_advice(
    alpha: float, beta: float, quadratic: float, delta: float, delay: float
) -> None:
    model = heave(alpha, beta + 0.02, quadratic, delta, delay)
    try:
        proposal = design(model, uncertain(model), SUB_DEPTH, present(SUB_DEPTH))
    except NoGainsMeetSpec as error:
        assert "Try" in str(error)
        return
    assert proposal.worst_margins.stable
    assert all(c.low <= c.new <= c.high for c in proposal.changes)
