"""CSV files of spreadsheets, loggers and ROS: read if unambiguous, else rejected with advice."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.errors import BadFile
from gcs_autotune.trial import Trial, load_trial

HEAD, ROWS = "t[s],psi[deg],N[N m]", ["0.00,0.5,1.0", "0.10,0.6,-1.0", "0.20,0.7,1.0"]
PLAIN = "\n".join([HEAD, *ROWS]) + "\n"


def load(folder: Path, text: str | bytes, name: str = "mine.csv", **columns: str) -> Trial:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_trial(path, columns)


def notes(run: Trial) -> dict[str, str]:
    return {slug: cause for slug, cause, _ in run.meta.get("notes", ())}


COMMAS = PLAIN.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (COMMAS, "separates its columns by ';' and uses decimal commas.*sed 's/,/./g; s/;/,/g' mine.csv > run.csv"),
        (PLAIN.replace(",", ";"), r"separates its columns by ';'. Use ',' between"),
        (PLAIN.replace(",", "\t"), r"separates its columns by tabs.*sed 's/\\t/,/g'"),
        (PLAIN.replace(",", "|"), "separates its columns by '|'"),
        ("t psi N\n0 1 2\n1 1 2\n2 1 2\n", "separates its columns by spaces"),
        ("t,psi,N\n0,00,0,5,1,0\n0,10,0,6,1,0\n", "3 column heads but 6 cells in a row: it uses commas"),
        ('t,psi\n"0,00","0,5"\n"0,10","0,6"\n', "decimal commas"),
        (PLAIN.encode("utf-16"), "is in UTF-16. Save it as UTF-8"),
        (PLAIN.encode("utf-16-le"), "is in UTF-16LE. Save it as UTF-8"),
        (PLAIN.encode("utf-16-be"), "is in UTF-16BE. Save it as UTF-8"),
        (PLAIN.encode("utf-32"), "is in UTF-32. Save it as UTF-8"),
        ("time,psi\n2024-05-02 10:00:00.000,1\n2024-05-02 10:00:00.100,1\n", "is a date .*Use seconds"),
        ("time,psi\n02.05.2024 10:00,1\n02.05.2024 10:01,1\n", "is a date or a time of day. Use seconds"),
        ("time,psi\n10:00:01.5,1\n10:00:01.6,1\n", "is a date or a time of day. Use seconds"),
        ("2024-05-02T10:00:00Z,1\n", "contains no samples"),
        ("", "is empty"),
        (" \n\n", "is empty"),
        (HEAD + "\n", "contains no samples"),
        ("0,1,2\n1,2,3\n", "has no header line. Add one above the numbers"),
        ("t,psi\nseconds,heading angle\n0,1\n1,2\n", "row 2: 'seconds', 'heading angle' are words"),
        ("Trial of 2 May\n" + PLAIN, "row 1: 'Trial of 2 May' is a title above the header line. Remove"),
        (PLAIN + PLAIN, r"row 5, column 't\[s\]': 't\[s\]' repeats the header line"),
        ("t[s],N[N m]\n0,1_0\n1,2\n", "row 2, column 'N.N m.': '1_0' is not a number"),
        ("t[s],N[N m]\n0,١٢\n1,2\n", "is not a number"),
        ("t[s],N[furlong]\n0,1\n1,2\n", r"unit \[furlong\] is unknown"),
        ("t[s],psi[deg\n0,1\n1,2\n", "is not name"),
        ("t[s],N[us]\n0,0.5\n1,0.2\n", "N of run 'mine' is in pulses, but ranges from 0.2 to 0.5"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "it is not text"),
    ],
)  # fmt: skip
def test_an_irregular_table_is_rejected_by_name_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(BadFile, match=words) as refused:
        load(tmp_path, text)
    assert "mine" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert "codec" not in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("deg", "°").encode("cp1252"),
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        "# made by hand\n# " + PLAIN,
        "# t[s],psi[deg],N[N m]\n" + "\n".join(ROWS),
        "t,psi,N\ns,deg,N*m\n" + "\n".join(ROWS),
        "t,psi,N\n[s],[deg],[N m]\n" + "\n".join(ROWS),
        "\n".join([HEAD + ",", *(row + "," for row in ROWS)]),
        "\n".join(["," + HEAD, *(f"{i},{row}" for i, row in enumerate(ROWS))]),
        "\n".join([HEAD + ",frame_id", *(row + ",base_link" for row in ROWS)]),
        "\n".join(["[t[s]]," + HEAD.partition(",")[2], *ROWS]),
        PLAIN.replace("t[s]", "Time"),
        PLAIN.replace("N[N m]", "N[N*m]"),
    ],
)
def test_an_unambiguous_table_is_read(tmp_path: Path, text: str | bytes) -> None:
    run = load(tmp_path, text)
    assert run["psi"].t == pytest.approx([0.0, 0.1, 0.2])
    assert run["psi"].values == pytest.approx(np.radians([0.5, 0.6, 0.7]))
    assert (run["N"].unit, run["N"].values.tolist()) == ("N m", [1.0, -1.0, 1.0])


def test_a_text_column_is_left_out_and_reported(tmp_path: Path) -> None:
    run = load(tmp_path, "\n".join([HEAD + ",frame_id", *(row + ",base_link" for row in ROWS)]))
    assert "frame_id" not in run
    assert "frame_id" in notes(run)["text-columns"]


@pytest.mark.parametrize(("head", "scale"), [("t[ns]", 1e9), ("%time", 1e9), ("time", 1e6), ("stamp", 1e3), ("t", 1.0)])
def test_epoch_stamps_in_any_unit_are_converted_to_seconds(tmp_path: Path, head: str, scale: float) -> None:
    rows = [f"{round((1714644000.0 + 0.5 * k) * scale)},{k}" for k in range(0, 10, 2)]
    run = load(tmp_path, "\n".join([f"{head},N", *rows]))
    assert run["N"].t == pytest.approx(1714644000.0 + np.arange(5), abs=1e-3)
    assert ("epoch-stamps" in notes(run)) is (head != "t[ns]" and scale > 1.0)


@pytest.mark.parametrize("head", ["N", "N[us]", "N[pwm]", "N[µs]"])
def test_pulses_are_normalised_about_neutral(tmp_path: Path, head: str) -> None:
    run = load(tmp_path, f"t[s],{head},r\n0,1500,0\n1,1900,0\n2,1300,0\n3,0,0\n")
    assert (run["N"].unit, run["N"].values.tolist()) == ("1", [0.0, 1.0, -0.5, 0.0])
    assert "1300 to 1900 us" in notes(run)["pulses-N"]
    assert "(pulse - 1500 us) / 400 us" in notes(run)["pulses-N"]


def test_pulses_of_a_renamed_column_are_normalised(tmp_path: Path) -> None:
    for column in ("rudder[us]", "rudder"):
        run = load(tmp_path, f"t[s],{column},r\n0,1500,0\n1,1700,0\n", rudder="N")
        assert run["N"].values.tolist() == [0.0, 0.5]
    run = load(tmp_path, "t[s],rudder\n0,1500\n1,1700\n", rudder="delta")
    assert (run["delta"].unit, run["delta"].values.tolist()) == ("1", [0.0, 0.5])


def test_normalised_values_newtons_and_undriven_columns_are_not_pulses(tmp_path: Path) -> None:
    run = load(tmp_path, "t[s],N,X[N],servo1[us],depth_pulse\n0,-0.5,1500,1500,1500\n1,1,1700,1700,1600\n")
    assert run["N"].values.tolist() == [-0.5, 1.0]
    assert run["X"].values.tolist() == [1500.0, 1700.0]
    assert run["servo1"].unit == "pwm"
    assert notes(run) == {}


def test_a_renamed_column_keeps_the_unit_it_has_in_the_file(tmp_path: Path) -> None:
    run = load(tmp_path, "zeit[ms],kurs[deg]\n0,0\n500,90\n", zeit="t", kurs="psi")
    assert run["psi"].t.tolist() == [0.0, 0.5]
    assert run["psi"].values == pytest.approx([0.0, math.pi / 2.0])


def test_nan_inf_and_decreasing_times_are_counted(tmp_path: Path) -> None:
    rows = ["0,1,1", "1,nan,1", "2,inf,1", "1.5,1,-inf", "1.7,NaN,1", "nan,1,1", "3,,1", "2.9,1,1"]
    run = load(tmp_path, "\n".join(["t[s],psi[deg],N[N m]", *rows]))
    found = notes(run)
    assert found["no-numbers"].endswith("1 of t is nan, 2 of psi are nan, 1 of psi is inf, 1 of N is inf")
    assert found["rows-without-time"] == "1 of 8 rows of mine.csv have no time"
    assert found["time-runs-back"] == "the time of mine.csv jumps back 2 times, first from 2 to 1.5 s"
    assert len(run["psi"]) == 3


def test_a_column_with_an_unrelated_unit_is_ignored(tmp_path: Path) -> None:
    run = load(tmp_path, "t[s],N[N m],water[degC],field[T]\n0,1,12,0\n1,2,12,0\n")
    assert run["N"].values.tolist() == [1.0, 2.0]
