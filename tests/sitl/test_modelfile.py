"""Model files flown instead of the hull of a vehicle, against the tuner's simulation of the same numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.models import FORMS, CoupledModel, Form, SingleDof
from sitl import BadModel, read_model
from sitl.__main__ import main
from sitl.plants import Wrench
from tests.sitl.ground import boat, rov

YAW = Form(
    "yaw", "yaw", ("yaw",), ("N_rdot", "N_r", "N_rr", "N_0"), {}, {"N": (("N", 1.0),)}, coriolis=False
)  # fmt: skip
YAW_VALUES = {"N_rdot": -2.0, "N_r": -1.5, "N_rr": -0.5, "N_0": 0.05}
PLANE_VALUES = {
    "m": 8.0, "X_udot": -2.0, "Y_vdot": -6.0, "N_rdot": -0.5, "I_z": 0.4, "Y_rdot": -0.3, "X_u": -4.0, "X_uu": -2.0,
    "Y_v": -9.0, "Y_vv": -3.0, "N_r": -0.8, "N_rr": -0.4, "N_v": -0.6, "Y_r": 0.5, "X_vr": 0.7,
}  # fmt: skip
PLANE = Form(
    "plane", "plane", ("surge", "sway", "yaw"), tuple(PLANE_VALUES), {},
    {"X": (("X", 1.0),), "Y": (("Y", 1.0),), "N": (("N", 1.0),)},
)  # fmt: skip


def written(tmp_path, form, values, applied=(), **more):
    base = CoupledModel(form, {n: values[n] for n in form.parameters})
    path = tmp_path / "model.json"
    path.write_text(json.dumps({**ExtendedModel(base, tuple(applied)).to_dict(), **more}), encoding="utf-8")
    return path, base


def test_a_yaw_model_replaces_only_the_yaw_of_a_vehicle(tmp_path):
    path, _ = written(tmp_path, YAW, YAW_VALUES, constants={"swing": {"N": 3.0}})
    ground, plain = rov(model=read_model(path)), rov()
    axis = ground.vehicle.plant.axis("yaw")
    assert (axis.alpha, axis.beta, axis.beta2) == (2.0, 1.5, 0.5)
    assert ground.vehicle.actuators.full["yaw"] == 3.0
    assert ground.vehicle.plant.axis("surge").alpha == plain.vehicle.plant.axis("surge").alpha
    assert ground.vehicle.actuators.full["surge"] == plain.vehicle.actuators.full["surge"]


def test_a_model_of_one_axis_is_flown_with_its_derivatives(tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(SingleDof("yaw", "1", 2.0, 1.5, 0.5, delta=0.05, delay=0.2).to_dict()), encoding="utf-8")
    flown = read_model(path)
    assert flown.axes == {"yaw": (2.0, 1.5, 0.5)}
    assert flown.forces == {"N": 0.05}
    assert [e.slug for e in flown.effects] == ["input-delay"]


@pytest.mark.parametrize("craft", [rov, boat])
def test_a_vehicle_turns_as_the_tuner_predicts_from_the_same_file(tmp_path, craft):
    path, base = written(tmp_path, YAW, YAW_VALUES, constants={"swing": {"N": 3.0}})
    ground = craft(armed=False, model=read_model(path))
    vehicle = ground.vehicle
    start, t_0 = vehicle.state.r, ground.t
    vehicle.actuators.read = lambda pwm: {"N": 0.4, "X": 0.0, "Z": 0.0}
    ground.run(4.0)
    stamps = np.array([0.0, ground.t - t_0])
    predicted = base.simulate(np.array([0.0]), {"N": np.array([1.2])}, stamps, {"r": start})
    assert vehicle.state.r == pytest.approx(predicted.values["r"][-1], rel=1e-3)


def test_without_a_largest_command_full_output_is_one_unit(tmp_path):
    path, _ = written(tmp_path, YAW, YAW_VALUES)
    assert rov(model=read_model(path)).vehicle.actuators.full["yaw"] == 1.0


def test_effects_of_the_model_are_included_with_normalised_inputs(tmp_path):
    effects = [
        EffectInstance("dead-zone", "N", {"width": 0.6}, {"swing": 3.0}),
        EffectInstance("input-bias", "yaw", {"bias": 0.3}),
        EffectInstance("compass-deviation", "psi", {"B": 0.1, "C": 0.2, "A": 0.0}),
    ]
    path, _ = written(tmp_path, YAW, YAW_VALUES, effects)
    vehicle = rov(model=read_model(path)).vehicle
    found = {effect.slug: effect.values for effect in vehicle.effects}
    assert found["dead-zone"] == pytest.approx({"width": 0.2})
    assert found["input-bias"] == pytest.approx({"bias": 0.1})
    assert found["compass-deviation"] == {"B": 0.1, "C": 0.2, "A": 0.0}
    wrench = Wrench()
    for effect in vehicle.effects:
        effect.alter_force(0.0, wrench)
    assert wrench.N == pytest.approx(0.3)


def test_an_off_centre_sensor_of_the_model_is_an_effect_of_the_vehicle(tmp_path):
    path, _ = written(tmp_path, YAW.fixing({"x_P": 0.4, "y_P": 0.0}), {**YAW_VALUES, "x_P": 0.4, "y_P": 0.0})
    (effect,) = rov(model=read_model(path)).vehicle.effects
    assert (effect.slug, effect["x_P"], effect["y_P"]) == ("sensor-position", 0.4, 0.0)


def test_a_coupled_plane_moves_as_the_tuner_predicts(tmp_path):
    path, base = written(tmp_path, PLANE, PLANE_VALUES)
    plant = rov(model=read_model(path)).vehicle.plant
    body = plant.state
    body.u = body.v = body.r = body.psi = body.x = body.y = 0.0
    stamps = np.arange(0.0, 10.0, 0.02)
    wrench = Wrench(X=5.0, Y=2.0, N=1.0)
    track = []
    for _ in stamps:
        track.append((body.x, body.y, body.psi, body.u, body.v, body.r))
        plant.step(wrench, 0.02)
    inputs = {"X": np.array([5.0]), "Y": np.array([2.0]), "N": np.array([1.0])}
    predicted = base.simulate(np.array([0.0]), inputs, stamps, {})
    for name, values in zip(("x", "y", "psi", "u", "v", "r"), np.transpose(track), strict=True):
        assert values == pytest.approx(predicted.values[name], abs=1e-4), name
    assert abs(body.v) > 0.05


def test_thrust_and_rudder_of_a_coupled_ship_are_included(tmp_path):
    form = FORMS["rudder"]
    values = dict.fromkeys(form.parameters, 0.0)
    values.update(form.known)
    values.update({"X_0": 0.5, "X_uu": -0.5, "Y_|v|v": -1.0, "N_|r|r": -1.0, "Y_delta": -0.2, "N_delta": 0.3})
    path, _ = written(tmp_path, form, values, constants={"swing": {"delta": 0.5}})
    vehicle = boat(armed=False, model=read_model(path)).vehicle
    wrench = Wrench()
    vehicle.actuators.apply({"N": 1.0, "X": 0.0}, vehicle.plant.parameters, wrench)
    assert (wrench.X, wrench.Y, wrench.N) == pytest.approx((0.5, -0.1, 0.15))
    assert vehicle.state.u == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"model": "nomoto"}, "model: invalid value 'nomoto'"),
        ({"base": {}}, "is not a model file: base: missing entry 'form'"),
        ({"effects": [{"slug": "dead-zon", "place": "N", "values": {}}]}, "did you mean dead-zone?"),
        ({"effects": [{"slug": "dead-zone", "place": "N", "values": {}}]}, "dead-zone needs width"),
        ({"effects": [{"slug": "coriolis-coupling", "place": "", "values": {"X_vr": 1.0}}]}, "needs a hull with sway"),
    ],
)
def test_a_model_that_cannot_be_flown_is_explained_in_one_line(tmp_path, change, reason, capsys):
    path, _ = written(tmp_path, YAW, YAW_VALUES, **change)
    assert main(["automarine", "--model", str(path)]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_a_model_without_a_matching_axis_is_explained(tmp_path):
    form = Form("heave", "heave", ("heave",), ("Z_wdot", "Z_w"), {}, {"Z": (("Z", 1.0),)}, coriolis=False)
    path, _ = written(tmp_path, form, {"Z_wdot": -5.0, "Z_w": -2.0})
    with pytest.raises(BadModel, match="has heave, which this vehicle does not have"):
        boat(model=read_model(path))


def test_a_missing_file_is_explained(tmp_path, capsys):
    assert main(["automarine", "--model", str(tmp_path / "none.json")]) == 2
    assert "not a model file" in capsys.readouterr().err
