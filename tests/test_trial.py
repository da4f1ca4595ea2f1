"""Channels, trials and CSV runs by the sample."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, MissingChannel, UsageError
from gcs_autotune.trial import Channel, Mark, Trial, load_trial, save_trial


def channel(*values: float, name: str = "N", start: float = 1.0) -> Channel:
    return Channel(name, "N m", start + np.arange(len(values), dtype=np.float64), np.array(values))


@pytest.mark.parametrize(
    ("t", "value"), [(-5.0, 10.0), (0.999, 10.0), (1.0, 10.0), (1.999, 10.0), (2.0, 20.0), (2.5, 20.0), (99.0, 30.0)]
)
def test_an_input_holds_from_its_stamp_to_the_next_and_its_first_value_before(t: float, value: float) -> None:
    assert channel(10.0, 20.0, 30.0).held_at(t) == value


def test_a_part_has_both_its_ends_in_it() -> None:
    part = channel(10.0, 20.0, 30.0, 40.0).between(2.0, 3.0)
    assert (part.t.tolist(), part.values.tolist()) == ([2.0, 3.0], [20.0, 30.0])


def trial(**meta: object) -> Trial:
    late = channel(1.0, 2.0, 3.0, name="psi", start=2.5)
    empty = Channel("r", "rad/s", np.empty(0), np.empty(0))
    marks = tuple(Mark(t, "switch") for t in (1.0, 2.0, 3.0))
    return Trial("run", {"N": channel(10.0, 20.0), "psi": late, "r": empty}, marks, meta=meta)


def test_a_trial_lasts_from_its_first_stamp_to_its_last_of_any_channel() -> None:
    assert (trial().start, trial().end, trial().duration) == (1.0, 4.5, 3.5)
    nothing = Trial("run", {})
    assert math.isnan(nothing.start) and math.isnan(nothing.end)


def test_the_lead_in_is_left_out_of_the_manoeuvre_proper() -> None:
    proper = trial(from_t=2.0).proper
    assert proper["N"].t.tolist() == [2.0]
    assert proper["psi"].t.tolist() == [2.5, 3.5, 4.5]
    assert [m.t for m in proper.marks] == [2.0, 3.0]
    for meta in ({}, {"from_t": 1.0}, {"from_t": "later"}):
        whole = trial(**meta)
        assert whole.proper is whole


def test_a_channel_that_is_not_there_is_named_beside_those_that_are() -> None:
    with pytest.raises(MissingChannel, match="no channel 'delta'; it has N, psi, r"):
        trial()["delta"]
    assert "delta" not in trial() and "N" in trial()


def load(path: Path, text: str, **columns: str) -> Trial:
    path.write_text(text, encoding="utf-8")
    return load_trial(path, columns)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.csv"


def test_rows_without_a_time_are_left_out_of_every_channel(path: Path) -> None:
    run = load(path, "t[s],psi[deg],N[N m]\n0,0,1\n,90,2\nnan,90,3\n3,180,\n4,,5\n")
    assert run["psi"].t.tolist() == [0.0, 3.0]
    assert run["psi"].values == pytest.approx([0.0, math.pi])
    assert (run["N"].t.tolist(), run["N"].values.tolist()) == ([0.0, 4.0], [1.0, 5.0])
    assert run.meta["empty_cells"] == 4


@pytest.mark.parametrize(
    ("head", "first"), [("t[ms],N[N m]", 2.0), ("time[s],N[N m]", 2000.0), ("stamp[us],N[N m]", 0.002)]
)
def test_the_time_column_is_found_by_its_name_or_unit_and_put_into_seconds(path: Path, head: str, first: float) -> None:
    assert load(path, f"{head}\n2000,1\n3000,2\n")["N"].t[0] == pytest.approx(first)


def test_a_truncated_last_row_is_dropped_and_noted_and_one_before_it_is_not(path: Path) -> None:
    assert load(path, "t[s],N[N m]\n0,1\n1,2\n2\n").meta["dropped_rows"] == 1
    assert "dropped_rows" not in load(path, "t[s],N[N m]\n0,1\n1,2\n").meta
    with pytest.raises(BadFile, match="row 3: 1 cells instead of 2"):
        load(path, "t[s],N[N m]\n0,1\n1\n2,3\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t[s],N[N m]\n", "holds no samples"),
        ("t[s],N[N m]\n0\n", "no complete row"),
        ("x[m],N[N m]\n0,1\n", r"no time column t\[s\]; it has x, N\. .*--columns OLD=t\[s\]"),
        ("t[s],N[N m],N[kN m]\n0,1,1\n", "more than one column called N"),
        ("t[s],N[N m]\n0,one\n1,2\n", "row 2"),
    ],
)
def test_what_is_no_run_is_refused_with_what_is_wrong(path: Path, text: str, words: str) -> None:
    with pytest.raises(BadFile, match=words):
        load(path, text)


def test_columns_are_renamed_as_asked_and_only_those_that_are_there(path: Path) -> None:
    text = "zeit[s],kurs[deg]\n0,0\n1,90\n"
    run = load(path, text, zeit="t[s]", kurs="psi[deg]")
    assert run["psi"].values == pytest.approx([0.0, math.pi / 2.0])
    with pytest.raises(UsageError, match="no column ruder; it has zeit, kurs"):
        load(path, text, ruder="delta[deg]")


def test_a_saved_run_reads_back_with_its_marks_its_ending_and_each_channels_own_stamps(path: Path) -> None:
    run = Trial(
        "step", dict(trial().channels), (Mark(2.0, "switch", {"N": 0.3}),), "aborted", "too far", {"from_t": 2.0}
    )
    save_trial(run, path)
    back = load_trial(path)
    assert (back.name, back.ending, back.reason, back.meta["from_t"]) == ("step", "aborted", "too far", 2.0)
    assert back.marks == run.marks
    assert back["N"].t.tolist() == [1.0, 2.0]
    assert back["psi"].t.tolist() == [2.5, 3.5, 4.5]
    assert len(back["r"]) == 0


def test_what_is_unknown_is_left_out_of_the_side_file(path: Path) -> None:
    save_trial(Trial("run", {"N": channel(1.0, 2.0)}, meta={"a": math.nan, "b": math.inf, "c": 1.0, "d": "x"}), path)
    meta = load_trial(path).meta
    assert {k for k in meta if len(k) == 1} == {"c", "d"}


def test_a_spoilt_side_file_is_refused(path: Path) -> None:
    save_trial(trial(), path)
    path.with_suffix(".json").write_text('{"marks": [{"t": 1.0}]}', encoding="utf-8")
    with pytest.raises(BadFile, match="beside the run cannot be read"):
        load_trial(path)
