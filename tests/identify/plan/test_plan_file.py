"""Plan files: their content, what is rejected, and how estimates of several steps are combined."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, NotInformative, UnknownName
from gcs_autotune.identify.plan import load_plan, run_plan
from gcs_autotune.identify.plan.combine import StepEstimate, agreements, combined
from gcs_autotune.identify.plan.plan import PLANS, plan_from
from gcs_autotune.manoeuvres import MANOEUVRES
from gcs_autotune.trial import Channel, Trial

TWO = """
name = "two"
[known]
m = 10.0
[[step]]
name = "straight"
runs = ["line*"]
dofs = ["surge"]
shared = ["X_udot"]
isolated = ["X_u"]
held = ["m"]
coriolis = false
[step.inputs.X]
X = 1
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plan.toml"
    path.write_text(text)
    return path


def test_the_shipped_plan_identifies_the_23_parameters_of_seed_004():
    plan = load_plan("usv_6dof")
    assert set(plan.parameters) == {
        "X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r", "Y_r", "N_v", "I_x", "I_y", "I_z", "I_xz",
        "X_uu", "Y_vv", "Z_ww", "K_pp", "M_qq", "N_rr", "X_udot", "Y_vdot", "Y_rdot", "N_rdot", "C_DA",
    }  # fmt: skip
    assert len(plan.parameters) == 23


def test_the_plan_for_two_thrusters_selects_the_runs_that_fly_writes():
    plan = load_plan("usv_twin")
    assert len(plan.parameters) == 15
    run = Trial("run", {}, meta={"manoeuvre": "steps", "force": "N", "dof": "yaw"})
    other = Trial("other", {}, meta={"manoeuvre": "steps", "force": "X", "dof": "surge"})
    chosen = {step.name: [t.name for t in step.chosen.of([run, other])] for step in plan.steps}
    assert chosen == {"turning on the spot": ["run"], "thrust steps": ["other"], "spiral": [], "zig-zag": []}
    flown = {name.partition(" ")[0] for step in plan.steps for name in step.chosen.manoeuvres} & set(MANOEUVRES)
    assert flown == {"steps", "throttle-steps", "spiral", "zig-zag"}


def test_a_plan_accepts_the_constants_of_another_craft():
    plan = PLANS["usv_6dof"].knowing({"m": 30.0, "K_phi": -20.0})
    heave = next(s for s in plan.steps if s.name == "heave decay")
    roll = next(s for s in plan.steps if s.name == "roll decay")
    assert (heave.form.known["m"], roll.form.known["K_phi"]) == (30.0, -20.0)
    assert plan.final is not None and plan.final.form.known["m"] == 30.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('runs = ["line*"]', "", "select the runs with"),
        ('held = ["m"]', 'held = ["m", "X_uu"]', "X_uu is held, but no earlier step"),
        ('held = ["m"]', 'held = ["m", "X_u"]', "both held and identified"),
        ('dofs = ["surge"]', 'dofs = ["yaw"]', "equation of a degree of freedom that the form lacks"),
        ('shared = ["X_udot"]', 'shared = ["X_udto"]', "X_udto"),
        ("coriolis = false", "corioli = false", "corioli"),
        ("[[step]]", "[[stpe]]", "stpe"),
        ('name = "straight"', "", "name"),
        ("m = 10.0", "m = ", "cannot be read"),
    ],
)
def test_an_invalid_plan_is_rejected_with_the_place_of_the_mistake(tmp_path: Path, old: str, new: str, words: str):
    with pytest.raises(BadFile, match=words):
        load_plan(written(tmp_path, TWO.replace(old, new)))


def test_an_isolated_parameter_belongs_to_one_step(tmp_path: Path):
    again = (
        TWO[TWO.index("[[step]]") :]
        .replace('"straight"', '"again"')
        .replace('isolated = ["X_u"]', "")
        .replace('shared = ["X_udot"]', 'shared = ["X_udot", "X_u"]')
    )
    with pytest.raises(BadFile, match="X_u is isolated in 'straight'"):
        load_plan(written(tmp_path, TWO + again))


def test_an_unknown_plan_name_lists_the_available_plans():
    with pytest.raises(UnknownName, match="usv_6dof"):
        load_plan("usv_6df")


def test_runs_that_match_no_step_are_rejected_with_the_steps():
    t = np.arange(0.0, 5.0, 0.1)
    run = Trial("circle", {"u": Channel("u", "m/s", t, t)})
    with pytest.raises(NotInformative, match="straight"):
        run_plan(plan_from({"name": "p", "known": {"m": 1.0}, "step": [STRAIGHT]}, "p"), [run])


def flown(name: str, **meta: str) -> Trial:
    """A craft of 2 kg X_udot -1 and drag 0.8, pushed both ways."""
    t = np.arange(0.0, 40.0, 0.1)
    X, u = np.where(t % 16.0 < 8.0, 1.0, -0.5), np.zeros(len(t))
    for i in range(len(t) - 1):
        u[i + 1] = u[i] + 0.1 * (X[i] - 0.8 * u[i]) / 2.0
    noise = np.random.default_rng(1).normal(0.0, 0.005, len(t))
    return Trial(name, {"X": Channel("X", "N", t, X), "u": Channel("u", "m/s", t, u + noise)}, meta=meta)


@pytest.mark.parametrize("result", ["speed_steps", "speed-steps", "Speed Steps"])
def test_a_manoeuvre_is_the_same_with_hyphens_and_underscores(result: str) -> None:
    plan = plan_from({"name": "p", "known": {"m": 1.0}, "step": [STRAIGHT]}, "p")
    assert [s.step.name for s in run_plan(plan, [flown("a", manoeuvre=result)]).steps] == ["straight"]


def test_the_shipped_plan_selects_manoeuvres_by_the_names_that_fly_writes() -> None:
    plan = PLANS["usv_6dof"]
    for name, dof, step in (
        ("zig-zag", "yaw", "zig-zag"),
        ("spiral", "yaw", "spiral"),
        ("throttle-steps", "surge", "straight line"),
        ("hand-release", "roll", "roll decay"),
        ("hand-release", "pitch", "pitch decay"),
    ):
        run = flown("a", manoeuvre=name, dof=dof)
        assert [s.name for s in plan.steps if s.chosen.of([run])] == [step]
        assert name in MANOEUVRES
    assert not [s for s in plan.steps if s.chosen.of([flown("a", manoeuvre="throttle-steps", dof="yaw")])]
    old = flown("a", manoeuvre="zigzag")
    assert [s.name for s in plan.steps if s.chosen.of([old])] == ["zig-zag"]


def test_runs_used_by_no_step_are_reported() -> None:
    plan = plan_from({"name": "p", "known": {"m": 1.0}, "step": [STRAIGHT]}, "p")
    runs = [flown("a", manoeuvre="speed_steps"), flown("b", manoeuvre="chirp")]
    (doubt,) = [d for d in run_plan(plan, runs).doubts if d.slug == "runs-of-no-step"]
    assert doubt.cause.startswith("b belongs to no step")
    assert "speed_steps" in doubt.cure
    assert not [d for d in run_plan(plan, runs[:1]).doubts if d.slug == "runs-of-no-step"]


STRAIGHT = {
    "name": "straight", "manoeuvre": "speed_steps", "dofs": ["surge"], "isolated": ["X_u"], "shared": ["X_udot"],
    "held": ["m"], "inputs": {"X": {"X": 1}}, "coriolis": False,
}  # fmt: skip


def test_weighting_by_information_beats_the_plain_mean():
    rng = np.random.default_rng(0)
    stds, ours, plain, inside = np.array([0.01, 0.1, 0.5]), [], [], []
    for _ in range(400):
        values = 2.0 + stds * rng.normal(size=3)
        estimates = [StepEstimate(f"s{i}", ("a",), values[i : i + 1], np.array([[s**2]])) for i, s in enumerate(stds)]
        _, best, P = combined(estimates)
        ours.append(best[0])
        plain.append(np.mean(values))
        inside.append(abs(best[0] - 2.0) < 1.96 * np.sqrt(P[0, 0]))
    assert np.std(ours) < 0.1 * np.std(plain)
    assert 0.92 < np.mean(inside) < 0.98


def test_a_correlated_pair_of_one_step_is_resolved_by_another_step():
    # one step knows only a + b, the other only b: together both are known
    tied = np.array([[1.0, -0.9999], [-0.9999, 1.0]])
    names, values, P = combined(
        [
            StepEstimate("sum", ("a", "b"), np.array([3.5, 1.5]), tied),
            StepEstimate("b", ("b",), np.array([2.0]), np.array([[1e-4]])),
        ]
    )
    assert dict(zip(names, values, strict=True)) == pytest.approx({"a": 3.0, "b": 2.0}, abs=0.01)
    assert np.sqrt(P[0, 0]) < 0.03


def test_disagreeing_steps_have_a_small_probability():
    a, b = (StepEstimate(s, ("X_u",), np.array([v]), np.array([[0.01]])) for s, v in (("line", -5.0), ("spiral", -6.0)))
    (row,) = agreements([a, b])
    assert row.probability < 1e-6 and row.mean == row.combined == pytest.approx(-5.5)
    (calm,) = agreements([a, StepEstimate("spiral", ("X_u",), np.array([-5.1]), np.array([[0.01]]))])
    assert calm.probability > 0.1
