"""Two oscillations of different size distinguish a thruster that is weak for small commands from a linear one."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.identify import AxisFit, Fit, Parameter, Remainder, fit_axis
from gcs_autotune.identify.thrust import CURVE, describe_thrust_curve, fit_slow_actuator, fit_thrust_curve, thrust_curve
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import identification
from gcs_autotune.workflow.extra_relay import extra_relay
from gcs_autotune.workflow.identification import Identified, again_with_step
from gcs_autotune.workflow.proof import reduction_of, reduction_of_extended

ALPHA, DRAG, DT = 0.026, 0.065, 0.002
DEAD_BAND = 0.12


def oscillation(
    name: str, output: float, half_period: float, share: float, dead: float = 0.0, **further: float
) -> Trial:
    """A square wave on an ROV's yaw, thrust ``v (1 - share + share |v|)``, *v* what exceeds the dead band."""
    n, half_ticks = 10_000, round(half_period / DT)
    u = np.where((np.arange(n) + half_ticks // 2) // half_ticks % 2 == 0, output, -output)
    return flown(name, u, share, dead, {"C": output}, **further)


def self_oscillation(name: str, output: float, share: float, dead: float, astern: float) -> Trial:
    """A relay on the heading with a hysteresis of 0.1 rad, of a craft that pushes *astern* times as hard to port.

    It switches only when it is recorded.
    """
    u, psi, r, sense = [], 0.0, 0.0, 1.0
    for tick in range(10_000):
        if tick % 20 == 0:
            sense = -1.0 if psi > 0.1 else 1.0 if psi < -0.1 else sense
        u.append(sense * output)
        force = output * (1.0 - share + share * output) * (1.0 if sense > 0.0 else -astern)
        r += DT * (force - DRAG * abs(r) * r) / ALPHA
        psi += DT * r
    return flown(name, np.array(u), share, dead, {"C": output}, astern=astern)


def decaying_oscillation(share: float, dead: float, **further: float) -> Trial:
    """What a loop does after a step: an output that runs through all sizes and ends at what holds a constant force."""
    t = DT * np.arange(10_000)
    return flown("step", 0.5 * np.exp(-t / 6.0) * np.cos(2.0 * t), share, dead, {}, **further)


def flown(
    name: str,
    u: np.ndarray,
    share: float,
    dead: float,
    meta: dict[str, float],
    *,
    lost: float = 1.0,
    astern: float = 1.0,
    noise: float = 0.002,
) -> Trial:
    """Integrate the turn under commands *u* (n,), of whose size a share *lost* of the dead band is lost beyond it.

    Thrust to port is *astern* times that to starboard. Heading (with *noise* [rad]) and command are recorded at 25 Hz.
    """
    dt, n = DT, len(u)
    t = dt * np.arange(n)
    v = np.sign(u) * np.where(np.abs(u) > dead, np.abs(u) - lost * dead, 0.0)
    thrust = v * (1.0 - share + share * np.abs(v)) * np.where(v < 0.0, astern, 1.0)
    psi, r = np.zeros(n), 0.0
    for k in range(1, n):
        r += dt * (thrust[k - 1] - DRAG * abs(r) * r) / ALPHA
        psi[k] = psi[k - 1] + dt * r
    rng = np.random.default_rng(7)
    kept = slice(None, None, 20)
    return Trial(
        name,
        {
            "psi": Channel("psi", "rad", t[kept], psi[kept] + rng.normal(0.0, noise, len(t[kept]))),
            "N": Channel("N", "1", t[kept], u[kept]),
        },
        meta=meta,
    )


def two(share: float) -> list[Trial]:
    return [oscillation("relay-1", 0.3, 0.8, share), oscillation("relay-2", 0.6, 0.6, share)]


def test_a_thruster_weak_for_small_commands_is_detected_and_reported():
    runs = two(0.8)
    plain = fit_axis(runs, dof="yaw")
    found = fit_thrust_curve(runs, plain)
    assert found is not None
    assert found.parameters["quadratic-actuator@N.share"].value == pytest.approx(0.75, abs=0.15)
    assert 100.0 - found.fit_percent < 0.4 * (100.0 - plain.fit_percent)
    described = describe_thrust_curve(found, plain)
    assert "weak for small commands" in described
    share = found.parameters["quadratic-actuator@N.share"].value
    assert f"({share:.0%} at 60%, the largest output flown)" in described, "the figure of identify's table"


def test_a_linear_thruster_gets_no_curve():
    runs = two(0.0)
    assert fit_thrust_curve(runs, fit_axis(runs, dof="yaw")) is None


@pytest.fixture(scope="module")
def dead_band() -> tuple[list[Trial], AxisFit]:
    runs = [oscillation(f"relay-{n}", C, T, 0.0, DEAD_BAND) for n, C, T in ((1, 0.3, 0.8), (2, 0.6, 0.6))]
    return runs, fit_axis(runs, dof="yaw")


@pytest.mark.slow
def test_the_step_distinguishes_a_dead_zone_from_a_curve_where_two_sizes_cannot(dead_band: tuple[list[Trial], AxisFit]):
    runs, plain = dead_band
    assert "dead-zone@N.width" not in fit_thrust_curve(runs, plain).parameters
    found = fit_thrust_curve(runs, plain, decaying_oscillation(0.0, DEAD_BAND))
    assert found.parameters["dead-zone@N.width"].value == pytest.approx(DEAD_BAND, abs=0.01)
    assert (
        "the oscillations and the step together are explained best by an actuator that does nothing below 12"
        in describe_thrust_curve(found, plain, decaying_oscillation(0.0, DEAD_BAND))
    )


@pytest.mark.slow
def test_thrust_that_is_weaker_one_way_is_not_taken_for_a_constant_force():
    craft = {"share": 0.8, "dead": 0.0, "astern": 0.8}
    runs = [self_oscillation(name, C, **craft) for name, C in (("relay-1", 0.3), ("relay-2", 0.6))]
    step, plain = decaying_oscillation(**craft), fit_axis(runs, dof="yaw")
    found = fit_thrust_curve(runs, plain, step)
    assert found.parameters["asymmetric-thrust@N.ratio"].value == pytest.approx(0.8, abs=0.03)
    assert abs(found.parameters["N_0"].value) < 0.003
    assert "of that to starboard" in describe_thrust_curve(found, plain, step)


@pytest.mark.slow
@pytest.mark.parametrize("with_band", [True, False])
def test_the_curve_of_a_turn_rate_loop_is_fitted_to_its_step_too(with_band: bool):
    runs, step = two(0.8), decaying_oscillation(0.8, 0.0)
    found = fit_thrust_curve(runs, fit_axis(runs, dof="yaw"), step, with_band=with_band)
    assert [
        slug for slug in ("dead-zone", "asymmetric-thrust") if any(n.startswith(slug) for n in found.parameters)
    ] == []
    assert ("step" in found.used) is with_band


def a_fit(explained: float, residual: Remainder | None = None, **numbers: float) -> SimpleNamespace:
    named = {f"{slug.replace('_', '-')}@X.{slug}": value for slug, value in numbers.items()}
    parameters = {name: Parameter(name, value, "1", 0.01 * value, "fitted") for name, value in named.items()}
    model = ExtendedModel(
        None, tuple(EffectInstance(slug.replace("_", "-"), "X", {"width": v}) for slug, v in numbers.items())
    )
    return SimpleNamespace(
        fit_percent=explained,
        unexplained=100.0 - explained,
        parameters=parameters,
        model=model,
        iso=("a cycle",),
        remainder={} if residual is None else {"psi": residual},
    )


@pytest.mark.parametrize(("square", "std", "reported"), [(0.6, 0.1, True), (0.6, 0.4, False), (0.1, 0.01, False)])
def test_a_thrust_curve_is_reported_if_it_is_significant_and_not_slight(square: float, std: float, reported: bool):
    curve = EffectInstance("quadratic-actuator", "X", {"share": square}, {"u_ref": 1.0})
    label = curve.label_of("share")
    fit = Fit(
        dof="surge",
        structure="linear",
        method="surge",
        model=SingleDof("surge", "1", 0.8, 0.25),
        parameters={label: Parameter(label, square, "1", std)},
        covariance=np.zeros((6, 6)),
        fit_percent=95.0,
        used=(),
        extra={CURVE: {"square": square, "std": std}},
        effects=(curve,),
    )
    reduction = reduction_of(fit)
    assert reduction is not None and bool(reduction.remarks) is reported


@pytest.mark.parametrize(("sizes", "step", "found"), [(3, None, True), (2, None, False), (3, "a step", False)])
def test_a_dead_zone_that_explains_three_sizes_is_reported(sizes, step, found, monkeypatch):
    """BlueROV2 surge: 10 % left straight, 8.8 with a curve, 6.4 with a dead zone; the linear one was reported."""
    fits = {("quadratic-actuator",): a_fit(91.2, quadratic_actuator=0.4), ("dead-zone",): a_fit(93.6, dead_zone=0.144)}
    monkeypatch.setattr(thrust_curve, "fit_with_actuator", lambda runs, plain, *slugs: fits.get(slugs))
    plain = a_fit(90.0)
    curve = fit_thrust_curve([None] * sizes, plain, step)
    assert (curve is fits["dead-zone",]) is found
    if found:
        announced = describe_thrust_curve(curve, plain)
        assert (
            announced
            == "the three oscillations are explained best by an actuator that does nothing below 14.4% of full output"
        )


def test_a_dead_zone_found_from_three_sizes_may_saturate_as_well(monkeypatch):
    fits = {
        ("quadratic-actuator",): a_fit(91.0, quadratic_actuator=0.4),
        ("dead-zone",): a_fit(93.3, dead_zone=0.141),
        ("saturation", "dead-zone"): a_fit(95.5, saturation=0.771, dead_zone=0.167),
    }
    monkeypatch.setattr(thrust_curve, "fit_with_actuator", lambda runs, plain, *slugs: fits.get(slugs))
    found = fit_thrust_curve([None] * 3, a_fit(89.7))
    assert found is fits["saturation", "dead-zone"]
    description = describe_thrust_curve(found, a_fit(89.7))
    assert "does nothing below 16.7% of full" in description
    assert "Above 77% of the autopilot's full output, the force of the model stays constant" in description


@pytest.mark.slow
def test_a_step_at_its_edge_distinguishes_a_speed_controllers_neutral_band_from_a_dead_zone():
    band, steps = 0.0625, 100.0
    runs = [oscillation(f"relay-{n}", C, T, 0.8) for n, C, T in ((1, 0.3, 0.8), (2, 0.6, 0.6))]
    t = 20 * DT * np.arange(400)
    dwelling = np.round(steps * (0.2 * np.exp(-t / 3.0) * np.cos(2.0 * t) + 0.075 * np.sin(1.1 * t))) / steps
    step = flown("step", np.repeat(dwelling, 20), 0.8, band, {}, lost=0.0)
    plain = fit_axis(runs, dof="yaw")
    found = fit_thrust_curve(runs, plain, step, with_band=True)
    assert found is not None
    zone = next(e for e in found.model.effects if e.slug == "dead-zone")
    assert zone.constants["subtracted"] == 0.0
    assert zone["width"] == pytest.approx(band, abs=1.0 / steps)
    actuator = reduction_of_extended(found, FIRMWARE["ardusub"].axes["heading"]).actuator
    assert float(actuator.static(np.array([band - 0.005]))[0]) == 0.0
    true = 0.07 * (0.2 + 0.8 * 0.07) * float(found.model.base.inertia[0, 0]) / ALPHA
    assert float(actuator.static(np.array([0.07]))[0]) == pytest.approx(true, rel=0.15)
    assert "acts at once beyond" in describe_thrust_curve(found, plain, step)


@pytest.mark.parametrize("axis", ["yaw", "speed"])
def test_the_step_of_a_boats_turn_rate_tune_is_not_used_in_its_model(axis: str):
    found = Identified(SimpleNamespace(), ())
    context = SimpleNamespace(axis=FIRMWARE["ardurover"].axes[axis])
    assert again_with_step(context, found, decaying_oscillation(0.0, 0.0)) is found


def test_an_rovs_turn_rate_step_is_used_in_its_model_with_a_neutral_band(dead_band):
    runs, plain = dead_band
    requested = []

    def run_in_background(work: Callable[..., object], *args: object, **named: object) -> None:
        requested.append((work, args, named))

    context = SimpleNamespace(
        axis=FIRMWARE["ardusub"].axes["heading"],
        settings=SimpleNamespace(structure=None),
        run_in_background=run_in_background,
        log=SimpleNamespace(say=requested.append),
    )
    step = decaying_oscillation(0.0, DEAD_BAND)
    assert again_with_step(context, Identified(plain, runs), step).extended is None
    assert requested == [
        "identifying from the experiments and the step",
        (fit_thrust_curve, (runs, plain, step), {"with_band": True}),
        (fit_slow_actuator, (runs, plain), {}),
    ]
    assert inspect.signature(fit_thrust_curve).parameters["with_band"].default is False


@pytest.mark.slow
def test_a_third_size_is_requested_until_it_has_been_flown(dead_band: tuple[list[Trial], AxisFit]):
    runs, plain = dead_band
    third = extra_relay(runs, plain)
    assert third is not None
    assert min(abs(third.output / 0.3 - 1.0), abs(third.output / 0.6 - 1.0)) > 0.2
    three = [*runs, oscillation("relay-3", third.output, 0.6, 0.0, DEAD_BAND)]
    assert extra_relay(three, fit_axis(three, dof="yaw")) is None


def test_a_linear_actuator_needs_no_third_size():
    runs = two(0.0)
    assert extra_relay(runs, fit_axis(runs, dof="yaw")) is None


def test_an_experiment_reports_the_model_with_the_curve_as_a_tune_does():
    runs, announced = two(0.8), []
    plain = fit_axis(runs, dof="yaw")

    def fit_reported(structure: str | None) -> AxisFit:
        log = SimpleNamespace(say=announced.append, fit=plain)
        settings = SimpleNamespace(structure=structure)
        context = SimpleNamespace(
            log=log, settings=settings, run_in_background=lambda work, *args, **named: work(*args, **named)
        )
        identification._extended(context, plain, runs, None)  # type: ignore[arg-type]
        return log.fit

    found = fit_reported(None)
    assert [e.slug for e in found.effects] == ["quadratic-actuator"]
    assert found.fit_percent > plain.fit_percent + 5.0
    assert found.covariance.shape == (len(found.parameters),) * 2 == (6, 6)
    assert found.correlation[0, 5] != 0.0
    assert any("weak for small commands" in text for text in announced)
    assert fit_reported("affine") is plain


def test_a_dead_zone_is_detected_beside_the_noise_of_a_coarse_compass(monkeypatch):
    """IES ROV heading, compass of two degrees: the dead zone explains half of what is not noise."""
    fits = {
        ("quadratic-actuator",): a_fit(96.7, Remainder(0.0117, 0.0101), quadratic_actuator=0.97),
        ("dead-zone", "quadratic-actuator"): a_fit(
            97.2, Remainder(0.0109, 0.0101), dead_zone=0.03, quadratic_actuator=0.82
        ),
    }
    monkeypatch.setattr(thrust_curve, "fit_with_actuator", lambda runs, plain, *slugs: fits.get(slugs))
    found = fit_thrust_curve([None] * 3, a_fit(80.0, Remainder(0.06, 0.0101)))
    assert found is fits["dead-zone", "quadratic-actuator"]
