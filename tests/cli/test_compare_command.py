"""``compare``: what changed between runs of one craft, as text, page and JSON."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs_autotune import api
from gcs_autotune.cli import main
from gcs_autotune.diagnose import CraftComparison
from gcs_autotune.identify import save_model
from gcs_autotune.report import ComparedRun, Comparison
from gcs_autotune.trial import Trial, save_trial

TUNED = {
    "title": "tune heading",
    "ending": "kept",
    "axis": "heading",
    "kept": True,
    "gains": {"ATC_STR_RAT_P": {}},
    "metrics": {"before": None, "after": {"itae": 2.0, "overshoot": 0.1, "rise": 1.5, "settling": None}},
}


def relay_run(seed: int, inertia: float = 1.0, manoeuvre: str = "relay", dof: str = "yaw") -> Trial:
    """A relay in yaw of a craft with drag 0.5, written independently of the package's models."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(600)
    force = 0.1 * np.sign(np.sin(2.0 * math.pi * t / 7.0) + 1e-9)

    def rate(at: float, x: np.ndarray) -> tuple[float, float]:
        return x[1], (force[min(int(at / 0.1 + 1e-9), 599)] - 0.5 * x[1]) / inertia

    psi, r = solve_ivp(rate, (0.0, t[-1]), (0.0, 0.0), t_eval=t, max_step=0.05, rtol=1e-8).y
    noise = rng.normal(0.0, math.radians(0.1), (2, 600))
    (run,) = api.load_runs(
        {"t[s]": t, "N": force, "psi[rad]": psi + noise[0], "r[rad/s]": r + noise[1]}, name="relay-1"
    )
    return Trial(run.name, run.channels, meta={"manoeuvre": manoeuvre, "dof": dof, "purpose": "identification"})


def directory(folder: Path, name: str, when: str, run: Trial, uid: str = "aa", **told: object) -> Path:
    place = folder / name
    (place / "trials").mkdir(parents=True)
    save_trial(run, place / "trials" / "01-relay-1.csv")
    (place / "summary.json").write_text(json.dumps({**TUNED, "when": when, **told}))
    (place / "setting_out.json").write_text(json.dumps({"vehicle": {"uid": uid}}))
    (place / "parameters_after.json").write_text(json.dumps({"ATC_STR_RAT_P": 0.3 if name == "may" else 0.7}))
    return place


def test_a_heavier_craft_is_reported_with_gains_and_steps_side_by_side(tmp_path, capsys):
    may = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    july = directory(tmp_path, "july", "2026-07-01T10:00:00", relay_run(2, inertia=1.4))
    page = tmp_path / "season.html"
    assert main(["compare", str(july), str(may), "--page", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "run 2 against run 1, yaw: inertia x 1.4" in printed
    assert printed.index("may") < printed.index("july")
    assert "ATC_STR_RAT_P" in printed
    assert "10 %" in printed
    assert "All models shown here have linear damping" in " ".join(printed.split())
    assert "The model of run 2 differs by more than the intervals" in printed
    assert "july" in page.read_text()


def dead_zone_run(seed: int) -> Trial:
    """A relay of growing size on a craft that does nothing below 0.08 of full output."""
    relay = relay_run(seed)
    rng, t = np.random.default_rng(seed), 0.1 * np.arange(600)
    force = (0.1 + 0.15 * (t > 30.0)) * np.sign(np.sin(2.0 * math.pi * t / 7.0) + 1e-9)
    acting, psi, r = np.sign(force) * (np.abs(force) - 0.08), np.zeros(600), np.zeros(600)
    for i in range(599):
        change = math.exp(-0.05)
        r[i + 1] = 2.0 * acting[i] + (r[i] - 2.0 * acting[i]) * change
        psi[i + 1] = psi[i] + 0.1 * 2.0 * acting[i] + (r[i] - 2.0 * acting[i]) * (1.0 - change) / 0.5
    values = {"N": force, "psi": psi + rng.normal(0.0, 0.002, 600), "r": r + rng.normal(0.0, 0.002, 600)}
    return replace(relay, channels={n: replace(c, values=values[n]) for n, c in relay.channels.items()})


def test_runs_that_found_a_dead_zone_are_compared_with_it(tmp_path, capsys):
    runs = []
    for seed, name in ((1, "may"), (2, "june")):
        run = dead_zone_run(seed)
        runs.append(directory(tmp_path, name, f"2026-0{4 + seed}-01T10:00:00", run))
        save_model(api.fit(run, "affine", dof="yaw", effects=["dead-zone@N"]), runs[-1] / "model.json")
    assert main(["compare", *map(str, runs), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["changed"] is False
    for compared in document["runs"]:
        model = compared["models"]["yaw"]
        assert model["dead-zone@N.width"]["value"] == pytest.approx(0.08, abs=0.005)
        assert model["alpha_r"]["value"] == pytest.approx(1.0, rel=0.05)
    assert main(["compare", *map(str, runs)]) == 0
    printed = capsys.readouterr().out
    assert "All models shown here have linear and quadratic damping, with dead zone" in " ".join(printed.split())
    heads, width = (line.split() for line in printed.splitlines() if line.startswith(("parameter", "width")))
    assert heads == ["parameter", "run", "1", "run", "2", "unit"]
    assert " ".join(width[-2:]) == "of full", "no column is cut off at 80 characters"


def test_a_difference_between_different_manoeuvres_is_not_attributed_to_the_craft(tmp_path, capsys):
    may = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    july = directory(tmp_path, "july", "2026-07-01T10:00:00", relay_run(2, inertia=1.4, manoeuvre="zig-zag"))
    assert main(["compare", str(may), str(july)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "The runs have different manoeuvres, so this need not be a change of the craft." in text
    assert "have changed" not in text


def test_an_unchanged_craft_is_unchanged_in_json(tmp_path, capsys):
    runs = [directory(tmp_path, n, f"2026-0{i}-01T10:00:00", relay_run(i)) for i, n in ((1, "may"), (2, "june"))]
    assert main(["compare", *map(str, runs), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["changed"] is False
    assert [run["gains"]["ATC_STR_RAT_P"] for run in document["runs"]] == [0.3, 0.7]
    assert document["runs"][0]["metrics"]["settling"] is None


def test_a_difference_that_is_significant_alone_is_stated_although_the_craft_is_unchanged():
    inertia, drag, trim = (1.0, 0.02), (1.0, 0.02), (0.1, 0.03)
    ratios = {"inertia": inertia, "drag": drag, "trim": trim}
    row = CraftComparison("yaw", ("a",), ratios, changed=False, causes=(), outside=("trim",))
    runs = tuple(ComparedRun(name, fits={}) for name in ("may", "june"))
    told = Comparison(runs, {"june": (row,)}).told
    assert "The difference in trim alone would be significant." in told
    assert "the usual 2 % from run to run" in told
    assert "trim alone" in row.summary
    assert "alone" not in Comparison(runs, {"june": (replace(row, outside=()),)}).told


def test_a_recheck_that_found_an_oscillation_is_in_the_verdict_with_its_gains(tmp_path, capsys):
    may = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    checked = {"title": "recheck heading", "ending": "oscillates", "kept": None, "metrics": {"before": {"rise": None}}}
    june = directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(2), **checked)
    (june / "parameters_after.json").rename(june / "parameters_before.json")
    assert main(["compare", str(may), str(june)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "The heading loop of run 2 oscillates. No change of the craft was found" in text
    assert "ATC_STR_RAT_P 0.3 0.7" in text
    (june / "parameters_before.json").unlink()
    assert main(["compare", str(may), str(june)]) == 0
    assert "ATC_STR_RAT_P 0.3 unknown" in " ".join(capsys.readouterr().out.split())


def test_a_motion_that_was_not_excited_is_not_compared(tmp_path, capsys):
    runs = []
    for i in (1, 2):
        run = relay_run(i)
        ahead = {"X": replace(run["N"], name="X"), "u": replace(run["r"], name="u", unit="m/s")}
        both = Trial(run.name, {**run.channels, **ahead}, meta=run.meta)
        runs.append(directory(tmp_path, f"day{i}", f"2026-05-0{i}T10:00:00", both))
    assert main(["compare", *map(str, runs), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert list(document["runs"][0]["models"]) == ["yaw"]
    assert document["runs"][0]["not_identified"]["surge"] == "the manoeuvres flown do not excite surge"


def test_runs_of_two_vehicles_raise_a_doubt_and_are_not_compared(tmp_path, capsys):
    one = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    other = directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(2, inertia=1.4), uid="bb")
    assert main(["compare", str(one), str(other)]) == 0
    output = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "2 different vehicles (aa, bb)" in output
    assert "The runs are of different vehicles" in output
    assert "payload" not in output and "have changed" not in output


def test_a_run_of_another_vehicle_does_not_hide_a_change_between_two_runs_of_one(tmp_path, capsys):
    runs = [
        directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1), uid="bb"),
        directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(1)),
        directory(tmp_path, "july", "2026-07-01T10:00:00", relay_run(2, inertia=1.4)),
    ]
    assert main(["compare", *map(str, runs)]) == 0
    output = capsys.readouterr().out
    assert "run 3 against run 2, yaw: inertia x 1.4" in output
    assert "run 2 against run 1" not in output
    assert "The model of run 3 differs by more than the intervals" in output


def test_a_small_ratio_is_not_shown_as_zero(tmp_path, capsys):
    one = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1, inertia=300.0))
    other = directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(2))
    assert main(["compare", str(one), str(other)]) == 0
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "inertia x 0.00" in printed
    assert "x 0.00 " not in printed


def test_itae_is_explained_only_with_its_column(tmp_path, capsys):
    for shown in (True, False):
        after = {"overshoot": 0.1, **({"itae": 2.0} if shown else {})}
        runs = [
            directory(tmp_path, f"{n}-{shown}", f"2026-0{i}-01T10:00:00", relay_run(i), metrics={"after": after})
            for i, n in ((1, "may"), (2, "june"))
        ]
        assert main(["compare", *map(str, runs)]) == 0
        assert ("ITAE" in capsys.readouterr().out) == shown


def test_a_long_run_name_keeps_its_ending(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    names = ("20260501-100000-launch-zig-zag", "20260601-100000-bluerov2-staircase")
    runs = [
        directory(tmp_path, n, f"2026-0{i}-01T10:00:00", relay_run(i), title="fly staircase", ending="completed")
        for i, n in enumerate(names, start=5)
    ]
    assert main(["compare", *map(str, runs)]) == 0
    printed = capsys.readouterr().out
    assert printed.count("completed") == 2
    assert all(n in printed for n in names)


@pytest.mark.parametrize(
    ("which", "code", "told"),
    [((0,), 2, "1 run given"), ((0, 0), 2, "given twice"), ((0, 9), 6, "none does not exist")],
)
def test_runs_that_cannot_be_compared_are_rejected_in_one_sentence(which, code, told, tmp_path, capsys):
    place = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    paths = [str(place) if i == 0 else str(tmp_path / "none") for i in which]
    assert main(["compare", *paths]) == code
    assert told in capsys.readouterr().err


def test_runs_without_a_common_motion_are_rejected(tmp_path, capsys):
    one = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    other = directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(2, dof="surge"), axis="speed")
    assert main(["compare", str(one), str(other)]) == 6
    assert "no loop and no model in common" in capsys.readouterr().err


def test_python_prints_the_same_comparison(tmp_path):
    one = directory(tmp_path, "may", "2026-05-01T10:00:00", relay_run(1))
    other = directory(tmp_path, "june", "2026-06-01T10:00:00", relay_run(2, inertia=1.4))
    found = api.compare([one, other])
    assert found.changed
    assert "inertia x 1.4" in str(found)
    assert "<table>" in found._repr_html_()
