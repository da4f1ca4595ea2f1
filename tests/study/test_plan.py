"""A study file and its cases."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.errors import BadFile
from gcs_autotune.study import load_plan


def plan_of(tmp_path: Path, text: str):
    path = tmp_path / "study.toml"
    path.write_text('title = "t"\ndo = "module:function"\n' + text)
    return load_plan(path)


def test_a_grid_has_every_combination_and_the_repeats_have_further_seeds(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 'seed = 5\nrepeats = 2\nfixed.argument.z = true\nvary.argument.x = [1, 2]\n'
                             'vary.argument.y = { from = 1.0, to = 100.0, steps = 3, scale = "log" }')  # fmt: skip
    found = [(c.given["argument.x"], c.given["argument.y"], c.given["seed"]) for c in plan]
    first = [(1, 1, 5), (1, 10, 5), (1, 100, 5), (2, 1, 5), (2, 10, 5), (2, 100, 5)]
    assert found == first + [(x, y, 6) for x, y, _ in first]
    assert all(c.given["argument.z"] is True for c in plan)


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_a_larger_random_design_begins_with_the_same_cases(design: str, tmp_path: Path) -> None:
    text = (
        f'design = "{design}"\ncases = %d\nvary.argument.x = {{ from = 0.0, to = 1.0 }}\nvary.argument.n = ["a", "b"]'
    )
    few, many = (plan_of(tmp_path, text % n)[:30] for n in (30, 2000))
    assert [c.given for c in few] == [c.given for c in many]
    assert {c.given["argument.n"] for c in few} == {"a", "b"}
    assert 0.3 < sum(c.given["argument.x"] for c in few) / 30 < 0.7


def test_all_cases_of_a_random_design_are_different(tmp_path: Path) -> None:
    """Equal values are likely: of 1000 numbers with six digits, two are equal in every other study."""
    plan = plan_of(tmp_path, 'design = "random"\ncases = 300\nrepeats = 2\nvary.argument.x = [1, 2]')
    assert len({case.point(plan.do) for case in plan}) == 600


def test_the_same_values_in_any_notation_are_the_same_point(tmp_path: Path) -> None:
    one, other = (plan_of(tmp_path, f"fixed.argument.x = {x}")[0].point("m:f") for x in ("2", "2.0"))
    assert one == other
    assert plan_of(tmp_path, "fixed.argument.x = 3")[0].point("m:f") != one


BAD = {
    'vary.seed = [1, "two"]': "vary.seed: expected a whole number, not 'two'",
    "repeat = 2": "unknown entry 'repeat'",
    'design = "sobol"\nvary.argument.x = [1]': "cases is missing",
    "cases = 3\nvary.argument.x = [1]": "cases: a grid",
    "vary.argument.x = []": "vary.argument.x: the list is empty",
    "vary.argument.x = [1, 1]": "vary.argument.x: a value appears twice",
    "vary.argument.x = 3": "vary.argument.x: expected a list or a range",
    "vary.argument.x = { from = 2.0, to = 2.0, steps = 3 }": "vary.argument.x: the range from 2 to 2 is empty",
    "vary.argument.x = { from = 0.0, to = 2.0, steps = 3, scale = 'log' }": "vary.argument.x: a logarithmic range",
    "vary.argument.x = { from = 0.0, to = 2.0 }": "vary.argument.x: a grid needs the number of values",
    "vary.argument.x = { from = 0.0, to = 2.0, step = 3 }": "vary.argument.x: unknown entry 'step'",
    "vary.argumnt.x = [1]": "vary.argumnt: unknown entry. Did you mean argument",
    "vary.tune.step = [1]": "vary.tune: unknown entry",
    "vary.effect.dead-zone = [1]": "vary.effect.dead-zone: no value belongs here",
    "vary.argument = {}": "vary.argument: the table is empty",
    "fixed.argument.x = [1]": "fixed.argument.x: expected a number",
    "fixed.argument.x = 1\nvary.argument.x = [1]": "argument.x is both fixed and varied",
    "vary.argument.x = [1]\nreport.map = ['argument.x', 'argument.y']": "report.map: 'argument.y' is not varied",
    "\n".join(f"vary.argument.x{k} = {{ from = 0, to = 1, steps = 1000 }}" for k in range(4)): "1000000000000 cases",
}


@pytest.mark.parametrize("text", list(BAD))
def test_a_wrong_entry_is_rejected_in_one_line_with_file_and_key(text: str, tmp_path: Path) -> None:
    with pytest.raises(BadFile) as refused:
        plan_of(tmp_path, text)
    assert str(tmp_path / "study.toml") in str(refused.value)
    assert BAD[text] in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_unknown_job_is_rejected_with_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text('title = "t"\ndo = "tun"\n')
    with pytest.raises(BadFile, match=r"do: 'tun' is not .* Did you mean tune"):
        load_plan(tmp_path / "study.toml")
