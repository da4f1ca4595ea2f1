"""An exported model is the same model: each file is read back or run, and compared with ours."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.cli.export_cmd import TARGETS as TOLD
from gcs_autotune.effects import EffectInstance, ExtendedModel, in_order, passage_of
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.export import TARGETS, equations_of, export_model
from gcs_autotune.identify import ModelFile, load_model
from gcs_autotune.models import FORMS, CoupledModel, Form, load_form
from sitl.ardupilot_json.physics import Physics
from sitl.catalogue import load_vehicle

STATES, POSITIONS = ("u", "v", "w", "p", "q", "r"), ("x", "y", "z", "phi", "theta", "psi")
NUMBERS = {
    "m": 20.0, "I_z": 4.0, "X_udot": -6.0, "Y_vdot": -15.0, "N_rdot": -3.0, "Y_rdot": -0.7, "X_u": -12.0, "X_uu": -8.0,
    "Y_v": -25.0, "Y_vv": -60.0, "N_r": -9.0, "N_rr": -5.0, "Y_r": 2.0, "N_v": -1.5, "N_uv": -3.0, "N_0": 0.4,
}  # fmt: skip


def a_boat(*effects: EffectInstance) -> ModelFile:
    """Surge, sway and yaw, coupled; forces in newtons."""
    form = Form(
        "boat", "made up", ("surge", "sway", "yaw"), tuple(NUMBERS), {}, {"X": (("X", 1.0),), "N": (("N", 1.0),)}
    )
    model = ExtendedModel(CoupledModel(form, NUMBERS), in_order(effects), {"X": 80.0, "N": 20.0})
    names = ("X_u", "N_r")
    return ModelFile("my boat", model, None, {"X": "N", "N": "N m"}, {}, names, np.diag([0.25, 0.01]))


def an_rov() -> ModelFile:
    values = {"X_udot": -20.0, "X_u": -30.0, "Z_wdot": -30.0, "Z_ww": -90.0, "N_rdot": -0.6, "N_rr": -1.5, "Z_0": -2.0}
    inputs = {c: ((c, 1.0),) for c in "XZN"}
    form = Form("rov", "made up", ("surge", "heave", "yaw"), tuple(values), {}, inputs, coriolis=False)
    model = ExtendedModel(CoupledModel(form, values), (), {"X": 85.0, "Z": 120.0, "N": 23.0})
    return ModelFile("rov", model, None, {"X": "N", "Z": "N", "N": "N m"})


def ours(file: ModelFile, inputs: dict[str, float], t: np.ndarray) -> dict[str, np.ndarray]:
    """Simulate from rest under inputs that are constant from 0 on."""
    names = [n for d in file.model.base.form.dofs for n in {"surge": "u", "sway": "v", "heave": "w", "yaw": "r"}[d]]
    commands = {c: np.array([0.0, inputs.get(c, 0.0)]) for c in file.model.base.form.inputs}
    found = file.model.predict(
        passage_of("run", np.array([-9.0, 0.0]), commands, dict.fromkeys([*names, "psi"], t)), {}
    )
    assert found is not None
    return found


@pytest.mark.parametrize("name", sorted(FORMS))
def test_the_exported_equations_match_the_kernel(name):
    """Against the rows that identification by regression uses, for every form of the table."""
    from gcs_autotune.models import balance_of, program_of

    form = load_form(name) if isinstance(FORMS[name], str) else FORMS[name]
    rng = np.random.default_rng(3)
    values = {n: float(rng.uniform(0.5, 1.5)) * (-1.0 if "_" in n else 1.0) for n in form.free}
    if any(n in values for n in ("reach", "bottom", "lag")) or any("near" in n or "wall" in n for n in form.parameters):
        pytest.skip("grows towards the bottom: reported as left out")
    base = CoupledModel(form, {**form.known, **values})
    equations = equations_of(ModelFile(name, ExtendedModel(base)), {})
    if equations.left:
        pytest.skip(f"told as left out: {equations.left[0]}")
    rows = list(equations.rows)
    nu, eta = np.zeros(6), np.zeros(6)
    nu[rows], eta[rows] = rng.normal(0.0, 0.5, len(rows)), rng.normal(0.0, 0.5, len(rows))
    inputs = {c: float(rng.normal()) for c in form.inputs}
    found = equations.acceleration(nu, eta, inputs)
    state = np.concatenate([eta[rows], nu[rows]])[None, :]
    left = balance_of(program_of(form), base.theta, state, found[rows][None, :], np.array([list(inputs.values())]))
    assert left.values == pytest.approx(np.zeros((1, len(rows))), abs=1e-9)


def run_fossen(text: str, inputs: list[float], t: np.ndarray, h: float) -> np.ndarray:
    """Run the class of a file as the simulator's main loop does; velocities (n, 6) at *t*."""
    space: dict[str, object] = {}
    exec(compile(text, "exported.py", "exec"), space)
    (vehicle,) = [thing() for name, thing in space.items() if isinstance(thing, type)]
    eta, nu, u = np.zeros(6), vehicle.nu, vehicle.u_actual
    kept = []
    for k in range(round(t[-1] / h) + 1):
        if k % round((t[1] - t[0]) / h) == 0:
            kept.append(nu)
        nu, u = vehicle.dynamics(eta, nu, u, np.array(inputs), h)
        c, s = math.cos(eta[5]), math.sin(eta[5])
        eta = eta + h * np.array([c * nu[0] - s * nu[1], s * nu[0] + c * nu[1], nu[2], nu[3], nu[4], nu[5]])
    return np.array(kept)


def test_the_fossen_class_moves_as_the_model():
    file = a_boat(
        EffectInstance("input-delay", "N", {"delay": 0.4}),
        EffectInstance("actuator-lag", "N", {"time_constant": 0.5}),
        EffectInstance("quadratic-drag", "yaw", {"coefficient": 2.0}),
    )
    written = export_model(file, "fossen")
    assert written.left == ()
    t = np.arange(0.0, 12.1, 0.5)
    expected = ours(file, {"X": 40.0, "N": 8.0}, t)
    found = run_fossen(written.text, [40.0, 8.0], t, 0.002)
    for column, name in ((0, "u"), (1, "v"), (5, "r")):
        assert found[:, column] == pytest.approx(expected[name], abs=4e-3 * np.ptp(expected[name]))


def test_the_matlab_file_has_the_same_equations():
    file = a_boat()
    text = export_model(file, "matlab").text
    assert text.startswith("function dx = my_boat(~, state, input)\n% MY BOAT  Equations of motion identified by")
    rng = np.random.default_rng(1)
    nu, inputs = np.array([1.2, -0.3, 0.0, 0.0, 0.0, 0.4]), {"X": 30.0, "N": -4.0}
    M, tau = np.zeros((6, 6)), np.zeros(6)
    known = {**dict(zip(STATES, nu, strict=True)), **dict(zip(POSITIONS, rng.normal(size=6), strict=True)), **inputs}
    for i, j, value in re.findall(r"^M\((\d),(\d)\) = (.*);$", text, re.MULTILINE):
        M[int(i) - 1, int(j) - 1] = float(value)
    for i, term in re.findall(r"^tau\((\d)\) = tau\(\d\) \+ (.*);$", text, re.MULTILINE):
        tau[int(i) - 1] += eval(term, {"abs": abs, "sin": math.sin, "cos": math.cos, **known})
    a, b = np.split(M @ nu, 2)
    assert "tau(4:6) = tau(4:6) - cross(nu(1:3), a) - cross(nu(4:6), b);" in text
    tau[:3] -= np.cross(nu[3:], a)
    tau[3:] -= np.cross(nu[:3], a) + np.cross(nu[3:], b)
    rows = [int(r) - 1 for r in re.search(r"^rows = \[(.*)\];$", text, re.MULTILINE)[1].split()]
    found = np.linalg.solve(M[np.ix_(rows, rows)], tau[rows])
    assert found == pytest.approx(equations_of(file, {}).acceleration(nu, np.zeros(6), inputs)[rows])


def test_the_gazebo_element_has_the_same_forces_in_its_axes():
    written = export_model(a_boat(EffectInstance("dead-zone", "N", {"width": 2.0})), "gazebo")
    plugin = ET.fromstring(written.text)
    assert plugin.attrib["name"] == "gz::sim::systems::Hydrodynamics"
    result = {e.tag: float(e.text) for e in plugin if e.tag != "link_name"}
    assert (result["xDotU"], result["yDotV"], result["nDotR"]) == (-6.0, -15.0, -3.0)
    turned = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    nu = np.array([1.2, -0.3, 0.0, 0.0, 0.0, 0.4])
    theirs, force = turned * nu, np.zeros(6)
    for name, value in result.items():
        row, rest = "xyzkmn".index(name[0]), name[1:]
        if rest.startswith("Dot"):
            continue
        first, _, size = rest.partition("abs")
        product = np.prod([theirs["UVWPQR".index(c)] for c in first])
        force[row] += value * product * (abs(theirs["UVWPQR".index(size)]) if size else 1.0)
    equations = equations_of(a_boat(), {})
    expected = np.zeros(6)
    for term in equations.terms:
        if not {"X", "N"} & set(term.factors) and term.factors:
            known = dict(zip(STATES, nu, strict=True))
            expected[term.row] += eval(term.text, {"abs": abs, **known})
    assert turned * force == pytest.approx(expected)
    assert any("dead-zone@N" in what for what in written.left + tuple(written.text.splitlines()))
    assert "the moment in yaw: 0.4 N m" in written.left, written.left


@pytest.mark.parametrize(("file", "shares"), [(a_boat(), {"X": 0.5, "N": 0.3}), (an_rov(), {"X": 0.5, "N": 0.3})])
def test_the_vehicle_file_moves_in_the_simulator_as_the_model(tmp_path, file, shares):
    written = export_model(file, "ardupilot-json")
    (tmp_path / "craft.toml").write_text(written.text)
    physics = Physics(load_vehicle(str(tmp_path / "craft.toml")))
    state, actuators = physics.craft.plant.state, physics.craft.actuators
    pwm = actuators.write([1500] * 16, {"X": 0.0, "N": 0.0, "Z": 0.0, **shares})
    t = np.arange(0.0, 6.01, 0.5)
    full = file.model.amplitude
    expected = ours(file, {c: s * full[c] for c, s in shares.items()}, t)
    found = {"u": [state.u], "r": [state.r]}
    for _ in t[1:]:
        for _ in range(25):
            physics.step(0.02, pwm)
        found["u"].append(state.u)
        found["r"].append(state.r)
    for name, series in found.items():
        assert series == pytest.approx(expected[name], abs=0.01 * np.ptp(expected[name])), name


def test_a_rudder_and_an_unknown_full_scale_are_rejected_with_the_option_to_use():
    plain = a_boat()
    without = ModelFile("boat", ExtendedModel(plain.model.base), None, plain.inputs)
    with pytest.raises(UsageError, match=r"--full-scale X=\.\.\.,N="):
        export_model(without, "ardupilot-json")
    assert export_model(without, "ardupilot-json", {"X": 80.0, "N": 20.0}).text == (
        export_model(plain, "ardupilot-json").text.replace("my boat", "boat")
    )
    form = Form("ship", "", ("yaw",), ("N_rdot", "N_r", "N_delta"), {}, {"delta": (("N", "N_delta"),)})
    ship = ModelFile("ship", ExtendedModel(CoupledModel(form, {"N_rdot": -1.0, "N_r": -1.0, "N_delta": 1.0})))
    with pytest.raises(UsageError, match="--model FILE --ardupilot-json"):
        export_model(ship, "ardupilot-json")


def test_the_csv_table_contains_units_and_standard_errors():
    rows = list(csv.DictReader(io.StringIO(export_model(a_boat(), "csv").text)))
    assert {r["name"]: float(r["value"]) for r in rows} == NUMBERS
    by_name = {r["name"]: r for r in rows}
    assert float(by_name["X_u"]["std"]) == 0.5
    assert by_name["Y_v"]["std"] == ""
    assert by_name["X_u"]["unit"] == "N s/m"


@pytest.mark.parametrize("target", ["matlab", "gazebo"])
def test_a_delay_left_to_the_caller_is_listed_as_not_exported(target):
    late = export_model(a_boat(EffectInstance("input-delay", "N", {"delay": 0.4})), target)
    assert "the delay of N, 0.4 s" in late.text.partition("Not exported:")[2].splitlines()[0]
    assert "Not exported: nothing" in export_model(a_boat(), "matlab").text


def test_gazebo_is_not_given_fractions_of_full_output_without_a_word():
    newtons = a_boat()
    fractions = replace(newtons, inputs={"X": "1", "N": "1"})
    assert not any("fractions of full output" in what for what in export_model(newtons, "gazebo").left)
    assert any("fractions of full output" in what for what in export_model(fractions, "gazebo").left)


def test_text_of_a_model_file_never_becomes_code():
    """A model file is foreign: its names are in comments, and an invalid input name is rejected."""
    file = a_boat()
    evil = '"""\nimport os\nos.abort()\n"""'
    named = ModelFile(evil, file.model, None, {"X": evil, "N": "N m"})
    for target in ("fossen", "matlab"):
        text = export_model(named, target).text
        assert "\nimport os" not in text
        assert "\nos.abort" not in text
    run_fossen(export_model(named, "fossen").text, [1.0, 0.0], np.array([0.0, 0.1]), 0.1)
    form = Form("boat", "", ("yaw",), ("N_rdot",), {}, {"N\nimport os": (("N", 1.0),)})
    with pytest.raises(BadFile, match="has an invalid name"):
        export_model(ModelFile("x", ExtendedModel(CoupledModel(form, {"N_rdot": -1.0}))), "fossen")


def test_the_command_exports_every_target_and_reports_what_is_left_out(tmp_path, capsys):
    assert set(TOLD) == set(TARGETS)
    file = a_boat(EffectInstance("dead-zone", "N", {"width": 2.0}))
    path = tmp_path / "boat.json"
    path.write_text(json.dumps(file.model.to_dict()))
    assert load_model(path).model.effects
    for target, row in TARGETS.items():
        assert main(["export", str(path), "--to", target]) == 0
        result = capsys.readouterr()
        assert Path(result.out.strip()).suffix == row.suffix
        assert "dead-zone@N (width 2)" in result.err
