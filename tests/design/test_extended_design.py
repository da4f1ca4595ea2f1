"""Design from a model with effects: what the loop is designed with, what is predicted, and what is reported."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.control import reference_model
from gcs_autotune.design import LAWS, Actuator, Proposal, Scenario, Spec, design, design_from, is_better, reduce
from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.effect_reduction import _LEFT_OUT, _REDUCED
from gcs_autotune.design.hunting import hunting_of
from gcs_autotune.design.laws.kernel import actuate
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.plant import Region, heavier
from gcs_autotune.design.prediction import predict_error
from gcs_autotune.design.proposal import problem_of
from gcs_autotune.design.refinement import passes
from gcs_autotune.design.selection import judge
from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel
from gcs_autotune.errors import NoGainsMeetSpec, UsageError
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.models import FORMS, CoupledModel, SingleDof

from .crafts import DEFAULTS, ROVER_DEFAULTS, ROVER_HEADING, SUB_DEPTH, SUB_HEADING, heave, yaw

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
ALPHA, BETA, SPEED = 0.8, 0.8, 2.0
SPEC = Spec(speed=SPEED, step_duration=20.0, noise_std=0.002)


def boat(*effects: EffectInstance, model: SingleDof | None = None) -> ExtendedModel:
    return ExtendedModel(as_extended(model or yaw(ALPHA, BETA)).base, effects)


def on(slug: str, place: str = "N", **values: float) -> EffectInstance:
    return EffectInstance(slug, place, values)


@njit
def compiled(output: float, step: ActuatorStep, memory: Array) -> float:
    """The compiled actuator has no entry from Python."""
    return actuate(output, step, memory)


def acted(actuator: Actuator, outputs: Array, dt: float = 0.02) -> Array:
    """Return the forces (n,) an actuator makes of outputs (n,) in turn."""
    memory, step = np.zeros(4), actuator.step(dt)
    return np.array([compiled(float(u), step, memory) for u in outputs])


def proposed(*effects: EffectInstance) -> Proposal:
    key = tuple((e.slug, e.place, *e.values.values()) for e in effects)
    if key not in _DONE:
        _DONE[key] = design_from(boat(*effects), ROVER_HEADING, ROVER_DEFAULTS, SPEC)
    return _DONE[key]


_DONE: dict[tuple[object, ...], Proposal] = {}


# -- the actuator in the simulated loop


def test_a_perfect_actuator_changes_nothing() -> None:
    outputs = np.random.default_rng(1).uniform(-1.0, 1.0, 50)
    np.testing.assert_array_equal(acted(Actuator(), outputs), outputs)
    law, scenario = LAWS["rover-heading"], Scenario(0.5, 20.0)
    plain = law.simulate(yaw(ALPHA, BETA), ROVER_DEFAULTS, scenario, SPEED, 0.0)
    other = law.simulate(yaw(ALPHA, BETA), ROVER_DEFAULTS, scenario, SPEED, 0.0, Actuator(backlash=1e-15))
    np.testing.assert_allclose(other.position, plain.position, atol=1e-10)


def test_each_part_of_the_actuator_obeys_its_law() -> None:
    u = np.array([0.0, 0.05, 0.3, 1.0, -0.05, -0.3, -1.0])
    np.testing.assert_allclose(acted(Actuator(dead_zone=0.1), u), [0, 0, 0.2, 0.9, 0, -0.2, -0.9], atol=1e-15)
    band = Actuator(dead_zone=0.1, subtracted=0.0)
    np.testing.assert_allclose(acted(band, u), [0, 0, 0.3, 1.0, 0, -0.3, -1.0], atol=1e-15)
    np.testing.assert_allclose(band.static(u), acted(band, u), atol=1e-15)
    np.testing.assert_allclose(acted(Actuator(limit=0.25), u), np.clip(u, -0.25, 0.25))
    np.testing.assert_allclose(acted(Actuator(astern=0.5), u), np.where(u < 0, 0.5 * u, u))
    np.testing.assert_allclose(acted(Actuator(square=0.5, reference=2.0), u), 0.5 * u + 0.25 * u * abs(u))
    backlash = acted(Actuator(backlash=0.2), np.array([0.0, 0.05, 0.3, 0.25, 0.0, -0.4, -0.35]))
    np.testing.assert_allclose(backlash, [0.0, 0.0, 0.2, 0.2, 0.1, -0.3, -0.3], atol=1e-15)
    np.testing.assert_allclose(acted(Actuator(rate=5.0), np.array([0.0, 1.0, 1.0, 0.95])), [0, 0.1, 0.2, 0.3])
    lag = acted(Actuator(lag=0.5), np.r_[0.0, np.ones(25)])
    assert lag[-1] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-9)


def test_margins_of_a_curved_actuator_do_not_depend_on_the_relay_size() -> None:
    """The same square law, identified by relays of 0.5 and 0.9 of full output: its gain per force is the same."""
    result = [Actuator(square=1.0, reference=reference) for reference in (0.5, 0.9)]
    per_force = [max(a.slopes()) / a.static(np.array([0.5]))[0] for a in result]
    assert per_force[0] == pytest.approx(per_force[1])


def test_a_curved_actuator_has_at_most_twice_the_margin_gain_at_full_output() -> None:
    for share in (0.2, 0.6, 1.0):
        actuator = Actuator(square=share, reference=0.9)
        low, high = actuator.static(np.array([0.999, 1.001]))
        assert (high - low) / 0.002 <= 2.0 * max(actuator.slopes()) + 1e-5


def test_a_settled_actuator_gives_the_force_requested_from_its_inverse() -> None:
    actuator = Actuator(dead_zone=0.1, backlash=0.04, square=0.6, astern=0.7)
    for force in (0.3, -0.3, 0.02):
        u = actuator.output_for(force)
        assert float(actuator.static(np.array([u]))[0]) == pytest.approx(force, abs=1e-3)
        assert acted(actuator, np.full(3, u))[-1] == pytest.approx(force, abs=1e-3)
    with pytest.raises(NoGainsMeetSpec, match="cannot hold the constant force"):
        actuator.output_for(-0.65)


def test_a_loop_at_rest_stays_at_rest_with_any_actuator() -> None:
    law, craft = LAWS["rover-heading"], yaw(ALPHA, BETA, 0.0, 0.15)
    for actuator in (Actuator(dead_zone=0.1), Actuator(backlash=0.1), Actuator(lag=0.5), Actuator(astern=0.6)):
        gains = {**ROVER_DEFAULTS, "ATC_STR_RAT_I": 0.5}
        motion = law.simulate(craft, gains, Scenario(1e-9, 20.0), SPEED, 0.0, actuator)
        assert np.ptp(motion.position) < 1e-3, actuator


def harmonic(backlash: float, amplitude: float) -> complex:
    """Return the describing function of a total *backlash* for a sine of *amplitude*, from one settled period."""
    phase = np.linspace(0.0, 4.0 * math.pi, 1601)
    u, y, held = amplitude * np.sin(phase), np.zeros(1601), 0.0
    for i, now in enumerate(u):
        held = min(max(held, now - 0.5 * backlash), now + 0.5 * backlash)
        y[i] = held
    last = slice(801, 1601)
    first = 2.0 * np.mean(y[last] * np.exp(-1j * phase[last])) * 1j
    return complex(first / amplitude)


def test_hunting_matches_the_describing_function() -> None:
    """Harmonic balance N(A) L(jw) = -1 knows nothing of the simulation; the first harmonic is good to some 10 %."""
    law, craft, backlash = LAWS["rover-heading"], yaw(ALPHA, BETA), 0.05
    settings = {**ROVER_DEFAULTS, "ATC_STR_RAT_P": 0.6, "ATC_STR_RAT_I": 0.6}
    delay = 0.03
    problem = DesignProblem(
        law, [], Region(craft, np.zeros((5, 5)), ()), settings, SPEC, 0.2, delay, actuator=Actuator(backlash=backlash)
    )
    found = hunting_of(problem, settings, 0.2)
    omega = np.linspace(0.2, 3.0, 400)
    s = 1j * omega
    loop = law.controller(settings, SPEED).at(s) / (ALPHA * s + BETA) * np.exp(-delay * s)
    balance = []
    for amplitude in np.geomspace(0.51 * backlash, 20.0 * backlash, 120):
        gap = np.abs(harmonic(backlash, float(amplitude)) * loop + 1.0)
        k = int(np.argmin(gap))
        balance.append((float(gap[k]), float(amplitude), k))
    gap, amplitude, k = min(balance)
    assert gap < 0.02, "no limit cycle is predicted"
    swing = abs(harmonic(backlash, amplitude)) * amplitude / abs(ALPHA * s[k] + BETA) / omega[k]
    assert found.is_limit_cycle
    assert found.period == pytest.approx(math.tau / omega[k], rel=0.1)
    assert found.amplitude == pytest.approx(swing, rel=0.2)


# -- designs with effects


def cost(gains: Proposal, aware: Proposal, *effects: EffectInstance) -> tuple[float, float]:
    """Return mean ITAE over a full and a small step, and overshoot, of a design on the craft with the effects."""
    r = reduce(boat(*effects), "yaw", {})
    law = LAWS["rover-heading"]
    region = Region(r.model, np.zeros((5, 5)), ())
    delay = 1.5 * law.loop_period(ROVER_DEFAULTS)
    problem = DesignProblem(law, [], region, ROVER_DEFAULTS, SPEC, law.usual_step, delay, actuator=r.actuator)
    settings = {**ROVER_DEFAULTS, **gains.new}
    steps = [predict_error(problem, settings, f * problem.step, 20.0) for f in (1.0, 1.0 / 3.0)]
    return float(np.mean([m.itae for m in steps])), max(m.overshoot for m in steps)


@pytest.mark.parametrize(
    "effect",
    [on("dead-zone", width=0.06), on("backlash", width=0.1), on("input-delay", delay=0.5)],
    ids=lambda e: e.slug,
)
def test_gains_designed_with_the_effect_are_better_on_the_craft_that_has_it(effect: EffectInstance) -> None:
    naive, aware = proposed(), proposed(effect)
    blind, seeing = cost(naive, aware, effect), cost(aware, aware, effect)
    priced = [itae * (1.0 + 4.0 * max(0.0, overshoot - 0.05)) for itae, overshoot in (blind, seeing)]
    assert priced[1] < 0.95 * priced[0], (blind, seeing)


def test_a_delay_makes_the_loop_slower_and_keeps_its_margins() -> None:
    quick, late = proposed(), proposed(on("input-delay", delay=0.5))
    assert late.wanted.omega_0 < 0.8 * quick.wanted.omega_0
    assert late.after.metrics.rise > quick.after.metrics.rise
    assert late.margins.phase >= SPEC.phase_margin and late.margins.gain >= SPEC.gain_margin
    settings = {**ROVER_DEFAULTS, **quick.new}
    r = reduce(boat(on("input-delay", delay=0.5)), "yaw", {})
    problem = DesignProblem(LAWS["rover-heading"], [], Region(r.model, np.zeros((5, 5)), ()), settings, SPEC, 0.5, 0.03)
    assert problem.margins(settings, quick.wanted, [r.model])[0].phase < late.margins.phase


def test_margins_include_a_lag_and_a_gain_that_differs_by_direction() -> None:
    settings = {**ROVER_DEFAULTS, **proposed().new}
    wanted = proposed().wanted
    region = Region(yaw(ALPHA, BETA), np.zeros((5, 5)), ())
    plain = DesignProblem(LAWS["rover-heading"], [], region, settings, SPEC, 0.5, 0.03)
    nominal = plain.margins(settings, wanted, [region.model])[0]
    slow = replace(plain, actuator=Actuator(lag=0.3)).margins(settings, wanted, [region.model])[0]
    strong = replace(plain, actuator=Actuator(ahead=2.0)).margins(settings, wanted, [region.model])[0]
    assert slow.phase < nominal.phase
    assert strong.gain == pytest.approx(nominal.gain / 2.0, rel=0.05)


def test_dead_zone_and_backlash_are_reported_with_their_effect_and_advice() -> None:
    text = " ".join(proposed(on("backlash", width=0.1)).notes)
    assert "oscillates by" in text and "Repair the linkage" in text
    proposal = proposed(on("dead-zone", width=0.06))
    assert "MOT_THR_MIN" in proposal.remarks[0].advice
    data = json.loads(json.dumps({n: proposal.to_dict()[n] for n in ("effects", "left_alone")}, allow_nan=False))
    assert data["effects"][0]["slug"] == "dead-zone" and "before" in data["left_alone"]
    sub = reduce(boat(on("dead-zone", width=0.0625)), "yaw", {}, law=SUB_HEADING.law).remarks[0].sentence
    assert "MOT_THR_MIN" not in sub and "ESC" in sub


def test_an_rovs_depth_is_designed_with_its_dead_zone_and_weight() -> None:
    effects = (on("dead-zone", "Z", width=0.0625), EffectInstance("net-buoyancy", "heave", {"force": 0.05}))
    model = ExtendedModel(as_extended(heave(0.4, 0.7)).base, effects)
    present = {**DEFAULTS["sub-depth"], "SCHED_LOOP_RATE": 50.0}
    proposal = design_from(model, SUB_DEPTH, present, Spec(step_duration=15.0))
    assert proposal.after.metrics.itae <= proposal.before.metrics.itae
    assert proposal.worst_margins.stable


# -- from model file to what a loop is designed with


def test_linear_effects_become_parameters_of_the_model() -> None:
    effects = (
        on("input-delay", delay=0.2),
        on("measurement-delay", "psi+r", delay=0.1),
        on("quadratic-drag", "yaw", coefficient=0.3),
        on("linear-drag", "yaw", coefficient=0.1),
        on("input-bias", "yaw", bias=0.05),
        on("quantisation", "psi", step=0.02),
    )
    r = reduce(boat(*effects), "yaw", {})
    assert (r.model.alpha, r.model.beta) == pytest.approx((ALPHA, BETA + 0.1))
    assert (r.model.beta_quadratic, r.model.delta, r.model.delay) == pytest.approx((0.3, 0.05, 0.3))
    assert r.quantum == 0.02 and r.actuator.is_perfect and r.model.input_unit == "1"


def test_a_rudder_in_radians_of_reversed_sign_gives_the_same_gains() -> None:
    full = -0.5  # rad of rudder at full output, port for positive angles
    turned = SingleDof("yaw", "rad", ALPHA * full, BETA * full, 0.0, 0.0, 0.0)
    effects = (
        EffectInstance("asymmetric-thrust", "delta", {"ratio": 0.5}),
        EffectInstance("dead-zone", "delta", {"width": 0.03}),
    )
    model = ExtendedModel(as_extended(turned).base, effects)
    spec = replace(SPEC, settling_time=3.0)
    there = design_from(model, ROVER_HEADING, ROVER_DEFAULTS, replace(spec, full_scale=full), inputs={"delta": "rad"})
    r = reduce(model, "yaw", {"delta": "rad"})
    fractions = r.actuator.in_fractions(full)
    assert (fractions.ahead, fractions.astern) == (0.5, 1.0)
    assert fractions.dead_zone == pytest.approx(0.06)
    here = design(
        yaw(ALPHA, BETA), np.zeros((5, 5)), ROVER_HEADING, ROVER_DEFAULTS, spec, replace(r, actuator=fractions)
    )
    assert there.new == here.new


def test_a_single_axis_is_extracted_from_a_coupled_model() -> None:
    form = FORMS["twin-thruster"]
    values = {n: form.known.get(n, 1.0) for n in form.parameters} | {"k_N": 0.4, "N_r": -0.6, "N_rdot": -0.3}
    model = ExtendedModel(CoupledModel(form, {n: values[n] for n in form.parameters}))
    r = reduce(model, "yaw", dict.fromkeys(form.inputs, "1"))
    at = form.dofs.index("yaw")
    assert r.model.alpha == pytest.approx(float(model.base.inertia[at, at]) / 0.8)
    assert r.model.beta == pytest.approx(0.6 / 0.8)
    assert "full output is the sum of" in r.remarks[0].treated
    with pytest.raises(UsageError, match="but not heave"):
        reduce(model, "heave", {})


def test_the_covariance_is_carried_over() -> None:
    names = ("N_rdot", "N_r", "input-delay@N.delay", "dead-zone@N.width")
    covariance = np.diag([0.04, 0.01, 0.0025, 1e-4])
    covariance[0, 1] = covariance[1, 0] = 0.01
    r = reduce(boat(on("input-delay", delay=0.2)), "yaw", {}, names=names, covariance=covariance)
    assert np.diag(r.covariance) == pytest.approx([0.04, 0.01, 0.0, 0.0, 0.0025])
    assert r.covariance[0, 1] == pytest.approx(0.01)


def test_a_payload_and_a_sagging_battery_are_within_the_margins() -> None:
    r = reduce(boat(EffectInstance("mass-change", "yaw", {"ratio": 1.8, "time": 20.0})), "yaw", {})
    region = heavier(Region(r.model, r.covariance, ()), r.heavier)
    assert [m.alpha for m in region.samples] == pytest.approx([1.8 * ALPHA])
    lost = reduce(boat(EffectInstance("mass-change", "yaw", {"ratio": 0.5, "time": 20.0})), "yaw", {})
    assert (lost.model.alpha, lost.heavier) == pytest.approx((0.5 * ALPHA, 2.0))
    assert reduce(boat(on("gain-drift", rate=1e-3)), "yaw", {}).actuator.weakest == pytest.approx(0.3)


def test_every_effect_of_the_catalogue_is_handled() -> None:
    assert set(EFFECTS) == set(_REDUCED) | set(_LEFT_OUT)


def test_gains_with_too_large_an_error_at_the_end_of_the_flown_step_are_not_proposed() -> None:
    """IES ROV heading: matched gains had an error of 4 % after 30 s, but of 8 % after the 9 s of the flown step."""
    craft = ExtendedModel(
        as_extended(SingleDof("yaw", "1", 0.22889, 0.15912, 0.35482, 0.000094)).base,
        (on("dead-zone", width=0.030652), EffectInstance("quadratic-actuator", "N", {"share": 0.811}, {"u_ref": 0.6})),
    )
    spec = Spec(
        step=math.radians(30.0),
        step_duration=30.0,
        windows=(9.5, 9.4),
        settled_band=0.0494,
        settled_time=6.0,
        settled_least=3.0,
        hold=3.4,
        noise_std=0.0125,
        jitter_std=0.0101,
        quantum=math.radians(2.0),
    )
    present = DEFAULTS["sub-heading"]
    reduction = reduce(craft, "yaw", {}, law=SUB_HEADING.law)
    problem = problem_of(reduction.model, reduction.covariance, SUB_HEADING, present, spec, reduction)
    wanted = reference_model("bessel", 4.64)
    slow = {"ATC_RAT_YAW_P": 0.5, "ATC_RAT_YAW_I": 0.017, "ATC_ANG_YAW_P": 1.578}
    before, after = (judge(problem, wanted, {**problem.settings, **gains}, 30.0) for gains in ({}, slow))
    assert is_better(before.prediction.metrics, after.prediction.metrics).better
    assert not passes(problem, before, after, 30.0)
    proposal = design_from(craft, SUB_HEADING, present, spec)
    assert proposal.after.metrics.itae < 0.3 * proposal.before.metrics.itae
