"""What a craft can do, against closed forms; what is not determined, and the parameters that follow."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import Authority, CraftModels, FlownModel, authority_of, limits_for
from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.models import CoupledModel, SingleDof
from gcs_autotune.report import authority_document
from gcs_autotune.report.toolkit.terminal import render_text

SURGE = SingleDof("surge", "1", alpha=0.4, beta=0.25)
YAW = SingleDof("yaw", "1", alpha=1.0, beta=1.5, delta=0.03)
RUDDER = {"SERVO1_FUNCTION": 26.0, "SERVO1_MIN": 1100.0, "SERVO1_TRIM": 1500.0, "SERVO1_MAX": 1900.0}
SKID = {"SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
AT_ONCE = {"MOT_SLEWRATE": 0.0, "CRUISE_THROTTLE": 50.0, "WP_SPEED": 1.5}


def surge(*effects: EffectInstance, low: float = -1.0) -> FlownModel:
    model = as_extended(SURGE)
    model = replace(model, effects=(*model.effects, *effects), units={"X": "1"})
    return FlownModel("surge", model, ("X_u",), np.array([[0.01**2]]), {"X": 1.0}, 1.0, {"X": (low, 1.0)})


def yaw(speed: float = 2.0, alpha: float = 1.0, steered: float = 1.0, ahead: float = 0.5) -> FlownModel:
    model = replace(as_extended(replace(YAW, alpha=alpha)), units={"N": "1"})
    covariance = np.diag([0.02**2, 0.03**2])
    flown = {"N": (-steered, steered), "X": (0.0, ahead)}
    return FlownModel("yaw", model, ("N_rdot", "N_r"), covariance, {"N": 1.0}, speed, flown)


def found(settings: dict[str, float], *yaws: FlownModel, along: FlownModel | None = None) -> Authority:
    return authority_of(CraftModels(along or surge(), yaws or (yaw(),), {**AT_ONCE, **settings}))


def test_speeds_stops_and_turns_match_the_equations() -> None:
    figures = found(RUDDER).figures
    assert figures["top-ahead"].value == pytest.approx(4.0, rel=0.01)
    assert figures["top-astern"].value == pytest.approx(4.0, rel=0.01)
    assert figures["current"].value == pytest.approx(3.2, rel=0.01)
    lag, speed = 0.4 / 0.25, 2.0
    assert figures["stop-coasting"].value == pytest.approx(0.9 * speed * lag, rel=0.01)
    assert figures["stop-time-coasting"].value == pytest.approx(lag * math.log(10.0), rel=0.01)
    assert figures["turn-rate-starboard"].value == pytest.approx(1.03 / 1.5, rel=0.01)
    assert figures["turn-rate-port"].value == pytest.approx(0.97 / 1.5, rel=0.01)
    assert figures["turn-acceleration-starboard"].value == pytest.approx(1.0, rel=0.05)
    assert figures["moment-port"].value == pytest.approx(1.03)
    assert figures["moment-starboard"].value == pytest.approx(0.97)


def quick_rov() -> FlownModel:
    """Return the yaw model of a small ROV flown up to 67 %: quadratic drag and a thrust curve."""
    model = as_extended(SingleDof("yaw", "1", alpha=0.0217, beta=1e-6, beta_quadratic=0.055, delta=0.0018))
    curve = EffectInstance("quadratic-actuator", "N", {"share": 0.66}, {"u_ref": 0.67})
    flown = {"N": (-0.67, 0.67)}
    return FlownModel("yaw", replace(model, effects=(curve,), units={"N": "1"}), full={"N": 1.0}, flown=flown)


def test_an_rov_with_a_thrust_curve_holds_its_full_output_and_has_no_circle() -> None:
    can = authority_of(CraftModels(None, (quick_rov(),), rover=False))
    force = 0.34 + 0.66 / 0.67  # at full output, in the model's unit
    moments = [can.figures[f"moment-{side}"].value for side in ("port", "starboard")]
    assert moments == pytest.approx([1.0 + 0.0018 / force, 1.0 - 0.0018 / force], rel=1e-3)
    assert can.figures["turn-rate-starboard"].value == pytest.approx(math.sqrt((force + 0.0018) / 0.055), rel=0.01)
    assert can.circles == ()
    texts = [row.fly for row in can.missing]
    assert any("fly steps --force N --steering 1" in text for text in texts)
    assert not any("wind" in text for text in texts)
    assert any("thrust curve of the model" in text for text in can.assumed)


def test_the_acceleration_of_a_quick_craft_is_resolved_from_a_straight_start() -> None:
    figures = authority_of(CraftModels(None, (quick_rov(),), rover=False)).figures
    force = 0.34 + 0.66 / 0.67
    starts = {side: figures[f"turn-acceleration-{side}"].value for side in ("port", "starboard")}
    assert starts["starboard"] == pytest.approx((force + 0.0018) / 0.0217, rel=0.01)
    assert starts["port"] == pytest.approx((force - 0.0018) / 0.0217, rel=0.01)
    # r = r_0 tanh(t / tau) with tau = sqrt(alpha^2 / (drag force)): 0.8 r_0 after 1.0986 tau
    rate, tau = math.sqrt(force / 0.055), 0.0217 / math.sqrt(0.055 * force)
    means = [figures[f"turn-acceleration-mean-{side}"].value for side in ("port", "starboard")]
    assert means == pytest.approx([0.8 * rate / (math.atanh(0.8) * tau)] * 2, rel=0.02)


def test_standard_errors_come_from_the_covariance_of_the_models() -> None:
    figures = found(RUDDER).figures
    assert figures["top-ahead"].std == pytest.approx(4.0 * 0.01 / 0.25, rel=0.02)
    assert figures["turn-rate-port"].std == pytest.approx(0.97 / 1.5**2 * 0.03, rel=0.02)
    low, high = figures["top-ahead"].interval
    assert high - low == pytest.approx(2.0 * 1.96 * figures["top-ahead"].std)


def test_a_figure_beyond_the_flown_output_has_no_interval() -> None:
    slow = replace(surge(), flown={"X": (-0.5, 0.5)})
    beyond = {"top-ahead", "top-astern", "current", "acceleration", "stop-coasting-top", "stop-astern"}
    craft = found(RUDDER, yaw(steered=0.5), along=slow)
    turns = {"turn-rate-port", "turn-acceleration-mean-port", "turn-ratio", "moment-port"}
    for slug in beyond | turns:
        assert "largest output flown 50 %" in craft.figures[slug].note
        assert not math.isfinite(craft.figures[slug].interval[0])
        assert not math.isnan(craft.figures[slug].sure)
    for slug in ("cruise-speed", "stop-coasting", "stop-time-coasting", "deceleration-coasting"):
        assert not craft.figures[slug].extrapolated
        assert math.isfinite(craft.figures[slug].interval[0])
    assert craft.circles[0].rates["port"].extrapolated
    assert not any(figure.extrapolated for figure in found(RUDDER).figures.values())


def test_turn_rates_of_a_rudder_are_given_only_at_the_flown_speeds() -> None:
    one = found(RUDDER)
    assert [c.throttle for c in one.circles] == [0.5]
    assert any("--throttle 0.25" in row.fly for row in one.missing)
    assert "The turn rates are those of the heading runs at 2 m/s." in " ".join(one.assumed)
    two = found(RUDDER, yaw(1.0, alpha=4.0), yaw(2.0))
    assert [c.throttle for c in two.circles] == [0.25, 0.5]
    assert two.figures["steerage"].value == pytest.approx(2.0 * math.sqrt(0.03), rel=0.01)
    assert not two.figures["steerage"].note
    assert "square" in one.figures["steerage"].note
    told = render_text(authority_document(found(RUDDER, yaw(steered=0.5)), ()))
    assert told.count("Extrapolated: largest output flown 50 %.") == 2, "one per table that has such figures"
    assert "The steerage limit assumes" in told


def test_the_headline_has_no_more_digits_than_the_table() -> None:
    craft = found(RUDDER, yaw(steered=0.5))
    figures = {slug: replace(f, value=4.905, std=0.49) for slug, f in craft.figures.items() if "turn-rate" in slug}
    told = render_text(authority_document(replace(craft, figures=figures), ()))
    assert "The craft turns at 280°/s" in told and "turn rate to port" in told


def test_two_thrusters_share_their_output_and_the_weaker_one_pushes_ahead() -> None:
    weak = surge(EffectInstance("asymmetric-thrust", "X", {"ratio": 0.5}))
    circle = found(SKID, yaw(steered=0.3), along=weak).circles[1]
    assert circle.throttle == 0.5
    # outputs 1 and -1/3, thrusts 1 and -1/6
    assert circle.speed.value == pytest.approx(0.5 * (1.0 - 1.0 / 6.0) / 0.25, rel=0.01)
    assert circle.rates["starboard"].value == pytest.approx((0.5 * (1.0 + 1.0 / 6.0) + 0.03) / 1.5, rel=0.01)


def test_runs_with_thrust_ahead_do_not_determine_a_turn_with_a_thruster_astern() -> None:
    craft = found(SKID, yaw(steered=0.3), along=surge(low=0.0))
    assert "turn-rate-port" not in craft.figures
    assert "top-astern" not in craft.figures
    assert "stop-astern" not in craft.figures
    result = " ".join(f"{row.what} {row.fly}" for row in craft.missing)
    assert "stopping --throttle 1 --astern 1" in result
    assert "zig-zag --steering 1" in result
    assert "ATC_STR_RAT_MAX" not in {row.name for row in limits_for(craft)}


def test_one_coupled_model_gives_the_figures_of_its_two_parts() -> None:
    base = as_extended(SURGE).base, as_extended(YAW).base
    both = replace(
        base[0].form,
        dofs=("surge", "yaw"),
        free=(*base[0].form.free, *base[1].form.free),
        inputs={**base[0].form.inputs, **base[1].form.inputs},
    )
    model = ExtendedModel(CoupledModel(both, {**base[0].values, **base[1].values}), units={"X": "1", "N": "1"})
    coupled = FlownModel("both", model, full={"X": 1.0, "N": 1.0}, flown={"X": (-1.0, 1.0)})
    together = authority_of(CraftModels(coupled, (coupled,), {**AT_ONCE, **RUDDER}))
    apart = found(RUDDER)
    for slug in ("top-ahead", "stop-astern", "turn-rate-port", "turn-rate-starboard", "moment-port"):
        assert together.figures[slug].value == pytest.approx(apart.figures[slug].value, rel=0.01)
    assert len(together.circles) == 4


def test_parameters_follow_from_the_weaker_side_and_the_safe_end_of_its_interval() -> None:
    craft = found(RUDDER)
    rows = {row.name: row for row in limits_for(craft)}
    port = craft.figures["turn-rate-port"]
    assert rows["ATC_STR_RAT_MAX"].value == pytest.approx(0.8 * math.degrees(port.value - 1.96 * port.std), rel=1e-3)
    assert rows["WP_SPEED"].value == 1.5
    assert rows["CRUISE_SPEED"].value == pytest.approx(2.0, rel=0.01)
    assert rows["CRUISE_THROTTLE"].value == 50.0
    assert rows["SERVO1_TRIM"].value == 1488.0
    assert rows["TURN_RADIUS"].value == pytest.approx(2.0 / (port.value - 1.96 * port.std), rel=0.01)


@pytest.mark.parametrize(
    ("slug", "values", "name", "value"),
    [
        ("dead-zone", {"width": 0.08}, "MOT_THR_MIN", 8.0),
        ("dead-zone", {"width": 0.3}, "MOT_THR_MIN", 20.0),
        ("quadratic-actuator", {"share": 0.7}, "MOT_THST_EXPO", 0.7),
        ("asymmetric-thrust", {"ratio": 0.5}, "MOT_THST_ASYM", 2.0),
    ],
)
def test_an_actuator_effect_becomes_its_parameter(slug: str, values: dict[str, float], name: str, value: float) -> None:
    own = EffectInstance(slug, "X", values, {"u_ref": 1.0} if slug == "quadratic-actuator" else {})
    rows = {row.name: row for row in limits_for(found(SKID, along=surge(own)))}
    assert rows[name].value == pytest.approx(value)


def test_another_autopilot_gets_no_parameters() -> None:
    craft = CraftModels(surge(), (yaw(),), {}, throttle=0.5, rover=False)
    assert limits_for(authority_of(craft)) == ()


def test_an_insignificant_constant_force_counts_as_zero_in_the_drag() -> None:
    along = surge()
    base = along.model.base
    pushed = replace(base, values={**base.values, "X_0": 0.02, "X_u": -0.27})
    joint = np.array([[0.02**2, -0.95 * 0.02 * 0.02], [-0.95 * 0.02 * 0.02, 0.02**2]])
    model = replace(along.model, base=pushed)
    along = replace(along, model=model, names=("X_u", "X_0"), covariance=joint)
    top = found(RUDDER, along=along).figures["top-ahead"]
    # -0.27 less -0.95 times the force, by one standard error each
    assert top.value == pytest.approx(1.0 / 0.251, rel=0.01)
    assert top.std == pytest.approx(1.0 / 0.251**2 * 0.02 * math.sqrt(1.0 - 0.95**2), rel=0.05)
