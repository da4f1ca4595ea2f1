"""Channels, trials and CSV runs, sample by sample."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile, MissingChannel, UsageError
from gcs_autotune.trial import SCHEMA, Channel, Mark, Trial, load_trial, save_trial, trial_of_columns


def channel(*values: float, name: str = "N", start: float = 1.0) -> Channel:
    return Channel(name, "N m", start + np.arange(len(values), dtype=np.float64), np.array(values))


@pytest.mark.parametrize(
    ("t", "value"), [(-5.0, 10.0), (0.999, 10.0), (1.0, 10.0), (1.999, 10.0), (2.0, 20.0), (2.5, 20.0), (99.0, 30.0)]
)
def test_an_input_is_held_until_the_next_stamp_with_its_first_value_before(t: float, value: float) -> None:
    assert channel(10.0, 20.0, 30.0).held_at(t) == value


def test_a_segment_includes_both_ends() -> None:
    part = channel(10.0, 20.0, 30.0, 40.0).between(2.0, 3.0)
    assert (part.t.tolist(), part.values.tolist()) == ([2.0, 3.0], [20.0, 30.0])


def trial(**meta: object) -> Trial:
    late = channel(1.0, 2.0, 3.0, name="psi", start=2.5)
    empty = Channel("r", "rad/s", np.empty(0), np.empty(0))
    marks = tuple(Mark(t, "switch") for t in (1.0, 2.0, 3.0))
    return Trial("run", {"N": channel(10.0, 20.0), "psi": late, "r": empty}, marks, meta=meta)


def test_a_trial_lasts_from_the_first_to_the_last_stamp_of_any_channel() -> None:
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


def test_a_missing_channel_is_reported_with_those_available() -> None:
    with pytest.raises(MissingChannel, match=r"no channel 'delta'\. It contains N, psi, r"):
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
def test_the_time_column_is_found_by_name_or_unit_and_converted_to_seconds(path: Path, head: str, first: float) -> None:
    assert load(path, f"{head}\n2000,1\n3000,2\n")["N"].t[0] == pytest.approx(first)


def test_a_truncated_last_row_is_dropped_and_an_earlier_one_is_an_error(path: Path) -> None:
    assert load(path, "t[s],N[N m]\n0,1\n1,2\n2\n").meta["dropped_rows"] == 1
    assert "dropped_rows" not in load(path, "t[s],N[N m]\n0,1\n1,2\n").meta
    with pytest.raises(BadFile, match="row 3: 1 cell instead of 2"):
        load(path, "t[s],N[N m]\n0,1\n1\n2,3\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t[s],N[N m]\n", "contains no samples"),
        ("t[s],N[N m]\n0\n", "no complete row"),
        ("x[m],N[N m]\n0,1\n", r"no time column t\[s\]. Its columns are x, N\. .*--columns OLD=t\[s\]"),
        ("t[s],N[N m],N[kN m]\n0,1,1\n", "more than one column called N"),
        ("t[s],N[N m]\n0,one\n1,2\n", "row 2"),
    ],
)
def test_a_file_that_is_not_a_run_is_rejected_with_the_reason(path: Path, text: str, words: str) -> None:
    with pytest.raises(BadFile, match=words):
        load(path, text)


def test_only_existing_columns_can_be_renamed(path: Path) -> None:
    text = "zeit[s],kurs[deg]\n0,0\n1,90\n"
    run = load(path, text, zeit="t[s]", kurs="psi[deg]")
    assert run["psi"].values == pytest.approx([0.0, math.pi / 2.0])
    with pytest.raises(UsageError, match=r"no column ruder\. Its columns are zeit, kurs"):
        load(path, text, ruder="delta[deg]")


def test_a_saved_run_reads_back_with_marks_ending_and_stamps_of_each_channel(path: Path) -> None:
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


def test_unknown_values_are_left_out_of_the_side_file(path: Path) -> None:
    save_trial(Trial("run", {"N": channel(1.0, 2.0)}, meta={"a": math.nan, "b": math.inf, "c": 1.0, "d": "x"}), path)
    meta = load_trial(path).meta
    assert {k for k in meta if len(k) == 1} == {"c", "d"}


def test_a_damaged_side_file_is_rejected(path: Path) -> None:
    save_trial(trial(), path)
    side = path.with_suffix(".json")
    good = side.read_text(encoding="utf-8")
    for spoilt in (good[: len(good) // 2], good.replace('"t": ', '"at": ')):
        side.write_text(spoilt, encoding="utf-8")
        with pytest.raises(BadFile, match="cannot be read"):
            load_trial(path)


@pytest.mark.parametrize(
    "other",
    [
        '{"schema": 1, "verdict": "no-effect", "causes": []}',
        '{"schema": 1, "name": "mine"}',
        '{"type": "FeatureCollection", "features": []}',
        "[1, 2, 3]",
        "null",
        "[" * 100_000,
        "no json",
        "",
    ],
)
def test_json_of_the_same_name_that_is_not_a_side_file_is_ignored(path: Path, other: str) -> None:
    save_trial(trial(), path)
    path.with_suffix(".json").write_text(other, encoding="utf-8")
    run = load_trial(path)
    assert (run.name, run.marks, run.ending) == (path.stem, (), Trial("x", {}).ending)


def test_a_binary_file_of_the_same_name_is_ignored(path: Path) -> None:
    save_trial(trial(), path)
    path.with_suffix(".json").write_bytes(b"\xff\xfe\x00")
    assert load_trial(path).marks == ()


@pytest.mark.parametrize(
    ("meta", "purpose"),
    [
        ({}, ""),
        ({"purpose": "proof"}, "proof"),
        ({"purpose": "proof", "manoeuvre": "relay"}, "proof"),
        ({"manoeuvre": "relay"}, "identification"),
        ({"manoeuvre": "step"}, "proof"),
        ({"manoeuvre": "sign-check"}, "check"),
        ({"manoeuvre": "turn-about"}, "transit"),
        ({"manoeuvre": "dive"}, "transit"),
    ],
)
def test_the_purpose_of_a_run_is_its_own_or_that_of_its_manoeuvre(meta: dict[str, str], purpose: str) -> None:
    assert trial(**meta).purpose == purpose


@pytest.mark.parametrize(
    ("meta", "marks", "by_relay"),
    [
        ({"manoeuvre": "relay"}, (), True),
        ({"manoeuvre": "steps"}, (Mark(1.0, "level"), Mark(2.0, "switch")), True),
        ({"manoeuvre": "steps"}, (Mark(1.0, "level"),), False),
        ({}, (), False),
    ],
)
def test_a_relay_is_recognised_by_its_switches_or_its_name(
    meta: dict[str, str], marks: tuple[Mark, ...], by_relay: bool
) -> None:
    assert Trial("run", {}, marks, meta=meta).by_relay is by_relay


def test_a_rounded_stamp_belongs_to_the_manoeuvre_proper() -> None:
    for early, count in ((4e-7, 2), (6e-7, 1)):
        at = Channel("N", "1", np.array([0.0, 2.0 - early, 3.0]), np.ones(3))
        assert len(Trial("run", {"N": at}, meta={"from_t": 2.0}).proper["N"]) == count


def test_normalised_outputs_become_forces_and_moments() -> None:
    shares = {n: Channel(n, "1", np.arange(2.0), np.array([0.5, -1.0])) for n in "XYZKMN"}
    run = Trial("run", {**shares, "r": channel(1.0, name="r")})
    full = run.with_full_scale({"X": 40.0, "Z": 20.0, "K": 3.0, "N": 2.0})
    assert [full[n].unit for n in "XZKN"] == ["N", "N", "N m", "N m"]
    assert full["X"].values.tolist() == [20.0, -40.0]
    assert full["N"].values.tolist() == [1.0, -2.0]
    assert (full["Y"].unit, full["r"].unit, run["X"].unit) == ("1", "N m", "1")
    with pytest.raises(UsageError, match="X of run 'run' is already in N"):
        full.with_full_scale({"X": 2.0})
    with pytest.raises(MissingChannel):
        run.with_full_scale({"Q": 2.0})


COLUMNS = {"t[ms]": [0.0, 500.0, math.nan], "psi[deg]": [0.0, math.nan, 90.0], "N": [1.0, 2.0, 3.0]}


def test_arrays_by_column_header_are_a_run() -> None:
    run = trial_of_columns(COLUMNS, "mine")
    assert (run.name, run.meta["source"], run.meta["empty_cells"]) == ("mine", "mine", 2)
    assert run.meta["notes"][0][1] == "1 of 3 rows of mine have no time"
    assert (run["psi"].t.tolist(), run["psi"].values.tolist(), run["psi"].unit) == ([0.0], [0.0], "rad")
    assert (run["N"].t.tolist(), run["N"].values.tolist()) == ([0.0, 0.5], [1.0, 2.0])
    renamed = trial_of_columns(COLUMNS, "mine", {"N": "Z[N]"})
    assert renamed["Z"].unit == "N" and "N" not in renamed


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"t[s]": [0.0, 1.0], "N": [1.0]}, "mine: columns must be numbers of equal length"),
        ({"t[s]": [0.0], "N": ["much"]}, "must be numbers"),
        ({"t[s]": [], "N": []}, "mine contains no samples"),
        ({"N": [1.0]}, "no time column"),
    ],
)
def test_arrays_that_are_not_a_run_are_rejected_with_the_reason(table: dict[str, list], words: str) -> None:
    with pytest.raises(BadFile, match=words):
        trial_of_columns(table, "mine")


def test_comments_blank_lines_and_a_byte_order_mark_are_skipped(path: Path) -> None:
    path.write_text("# a log\n\n  # more\nt[s],N[N m]\n0, 1\n\n# here\n1,2\n", encoding="utf-8-sig")
    assert load_trial(path)["N"].values.tolist() == [1.0, 2.0]
    assert load_trial(path).meta["empty_cells"] == 0
    with pytest.raises(BadFile, match="cannot be read as a CSV run"):
        load_trial(path.with_name("none.csv"))
    path.write_bytes(b"t[s],N\n0,\x00\xff\n")
    with pytest.raises(BadFile, match="cannot be read as a CSV run: it is not text"):
        load_trial(path)


def test_written_values_are_rounded_to_a_microsecond_and_nine_digits(path: Path) -> None:
    fine = Channel("psi", "rad", np.array([0.0, 0.12345678]), np.array([1.0 / 3.0, 1e-12]))
    coarse = Channel("N", "1", np.array([0.1234567, 1.0]), np.array([0.5, 0.25]))
    save_trial(Trial("run", {"psi": fine, "N": coarse}), path)
    assert path.read_text().splitlines() == [
        "t[s],psi[rad],N[1]", "0.000000,0.333333333,", "0.123457,1e-12,0.5", "1.000000,,0.25",
    ]  # fmt: skip
    side = json.loads(path.with_suffix(".json").read_text())
    assert side["schema"] == SCHEMA
    assert (side["name"], side["ending"], side["reason"], side["meta"], side["marks"]) == (
        "run",
        "imported",
        "",
        {},
        [],
    )
    save_trial(Trial("empty", {}), path)
    assert path.read_text().splitlines() == ["t[s]"]


def test_a_table_has_one_row_per_stamp_with_the_last_of_two_samples() -> None:
    pytest.importorskip("pandas")
    twice = Channel("psi", "rad", np.array([2.0, 1.0, 1.0]), np.array([3.0, 1.0, 2.0]))
    table = Trial("run", {"psi": twice, "N": channel(10.0, name="N", start=3.0)}).to_pandas()
    assert table.index.name == "t[s]"
    assert table.index.tolist() == [1.0, 2.0, 3.0]
    assert table["psi[rad]"].tolist()[:2] == [2.0, 3.0]
    assert table["N[N m]"].tolist()[2] == 10.0
    assert table["N[N m]"].isna().tolist() == [True, True, False]
    assert len(Trial("run", {}).to_pandas()) == 0
