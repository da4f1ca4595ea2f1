from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_autotune.errors import BadFile
from gcs_autotune.mavlink import load_params, save_params, save_qgc_params

VALUES = {"ATC_STR_RAT_P": 0.33000001311302185, "CRUISE_THROTTLE": 30.0, "PSC_JERK_Z": -1e-7}

FILES = {
    "mission planner": "#note\nATC_STR_RAT_P,0.2\nWP_SPEED,2.5\n",
    "mavproxy": "ATC_STR_RAT_P    0.2\nWP_SPEED         2.5 # a remark\n\n",
    "qgroundcontrol": "# Id Id Name Value Type\n1\t1\tATC_STR_RAT_P\t0.2\t9\n1\t1\tWP_SPEED\t2.5\t9\n",
    "with spaces": "  ATC_STR_RAT_P , 0.2\r\nWP_SPEED, 2.5\r\n",
    "json": '{"ATC_STR_RAT_P": 0.2, "WP_SPEED": 2.5}',
    "our json": '{"schema": 1, "parameters": {"ATC_STR_RAT_P": 0.2, "WP_SPEED": 2.5}}',
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_parameter_files_of_every_common_tool_are_read(tmp_path: Path, text: str) -> None:
    path = tmp_path / "boat.param"
    path.write_text(text)
    assert load_params(path) == {"ATC_STR_RAT_P": 0.2, "WP_SPEED": 2.5}


@pytest.mark.parametrize("name", ["a.param", "a.json"])
def test_saved_parameters_are_loaded_again(tmp_path: Path, name: str) -> None:
    save_params(tmp_path / name, VALUES, comment="before tuning\nboat 7")
    assert load_params(tmp_path / name) == pytest.approx(VALUES, rel=1e-8)


def test_a_json_file_contains_schema_comment_values_and_known_defaults(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_params(path, {"A": 0.25}, comment="before tuning")
    assert json.loads(path.read_text()) == {"schema": 1, "comment": "before tuning", "parameters": {"A": 0.25}}
    save_params(path, {"A": 0.25}, defaults={"A": 1.0})
    assert json.loads(path.read_text()) == {
        "schema": 1, "comment": "", "parameters": {"A": 0.25}, "defaults": {"A": 1.0},
    }  # fmt: skip


def test_a_qgroundcontrol_file_has_five_columns_and_a_header(tmp_path: Path) -> None:
    path = tmp_path / "a.params"
    save_qgc_params(path, {"A": 0.25, "B": 3.0}, {"B": 4}, (7, 2), comment="before tuning\nboat 7")
    head, rows = path.read_text().splitlines()[:-2], path.read_text().splitlines()[-2:]
    assert head == ["# before tuning", "# boat 7", "# ", "# Vehicle-Id Component-Id Name Value Type"]
    assert rows == ["7\t2\tA\t0.25\t9", "7\t2\tB\t3\t4"]
    assert load_params(path) == {"A": 0.25, "B": 3.0}


NONSENSE = {
    "empty": "",
    "only remarks": "# nothing\n",
    "no number": "WP_SPEED,fast\n",
    "not a number": "WP_SPEED,nan\n",
    "three columns": "WP_SPEED 2 3\n",
    "no name": "2.5,WP_SPEED\n",
    "long name": "A_NAME_THAT_IS_TOO_LONG,1\n",
    "broken json": '{"WP_SPEED": 2',
    "json list inside": '{"parameters": [1, 2]}',
    "json text": '{"WP_SPEED": "fast"}',
    "csv run": "t[s],psi[rad]\n0,1\n",
}


@pytest.mark.parametrize("text", NONSENSE.values(), ids=NONSENSE)
def test_a_malformed_file_raises_bad_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "boat.param"
    path.write_text(text)
    with pytest.raises(BadFile, match=r"boat\.param"):
        load_params(path)


def test_the_error_contains_the_line_number(tmp_path: Path) -> None:
    path = tmp_path / "boat.param"
    path.write_text("WP_SPEED,2\nCRUISE_SPEED\n")
    with pytest.raises(BadFile, match="line 2"):
        load_params(path)
    path.write_text("WP_SPEED,2\nCRUISE_SPEED,fast\n")
    with pytest.raises(BadFile, match=r"boat\.param, line 2: 'CRUISE_SPEED' = 'fast' is not"):
        load_params(path)
    path = path.with_suffix(".json")
    path.write_text('{"WP_SPEED": "fast"}')
    with pytest.raises(BadFile, match=r"boat\.json, 'WP_SPEED': 'WP_SPEED' = 'fast' is not"):
        load_params(path)


def test_a_file_that_cannot_be_opened_raises_bad_file(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="does not exist"):
        load_params(tmp_path / "none.param")
    with pytest.raises(BadFile, match="cannot be read"):
        load_params(tmp_path)
    with pytest.raises(BadFile, match="cannot be written"):
        save_params(tmp_path / "no" / "a.param", VALUES)


@given(st.binary(max_size=200))
def test_arbitrary_bytes_are_parameters_or_raise_bad_file(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.param"
    path.write_bytes(data)
    try:
        assert load_params(path)
    except BadFile as error:
        assert "fuzz.param" in str(error)


def test_the_file_format_follows_the_extension(tmp_path: Path) -> None:
    save_params(tmp_path / "a.param", {"P": 0.2, "WP_SPEED": 2.5}, comment="before\nboat 7")
    assert (tmp_path / "a.param").read_text() == "# before\n# boat 7\nP,0.2\nWP_SPEED,2.5\n"
    save_params(tmp_path / "a.json", {"P": 0.2}, comment="before")
    assert json.loads((tmp_path / "a.json").read_text()) == {"schema": 1, "comment": "before", "parameters": {"P": 0.2}}


def test_five_columns_are_read_as_qgroundcontrol_only_after_two_numeric_ids(tmp_path: Path) -> None:
    path = tmp_path / "a.params"
    path.write_text("1\t2\tP\t0.2\t9\n")
    assert load_params(path) == {"P": 0.2}
    for line in ("x\t1\tP\t0.2\t9\n", "1\tx\tP\t0.2\t9\n", "1\t1\tP\t0.2\n"):
        path.write_text(line)
        with pytest.raises(BadFile, match="line 1"):
            load_params(path)


def test_a_non_numeric_json_value_is_reported_with_file_and_name(tmp_path: Path) -> None:
    path = tmp_path / "gains.json"
    path.write_text('{"parameters": {"ATC_STR_RAT_P": 0.2, "ATC_STR_RAT_I": "much"}}')
    with pytest.raises(BadFile) as caught:
        load_params(path)
    assert str(caught.value).startswith(f"{path}, 'ATC_STR_RAT_I': 'ATC_STR_RAT_I' = 'much'")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A,1\nB,2\nA,3\n", "line 3: 'A' is already in line 1"),
        ("A,1\n1\t1\tA\t1\t9\n", "line 2: 'A' is already in line 1"),
        ('{"A": 1, "A": 2}', "'A' appears twice"),
        ('{"parameters": {"A": 1, "B": 2, "A": 1}}', "'A' appears twice"),
        ("A,1_0\n", "is not a parameter name and a number"),
        ("A,٣\n", "is not a parameter name and a number"),
        ("A,1e39\n", "is not a parameter name and a number"),
        ('{"A": "1_0"}', "is not a parameter name and a number"),
        ('{"A": true}', "is not a parameter name and a number"),
    ],
)
def test_duplicate_names_and_malformed_numbers_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "boat.param"
    path.write_text(text)
    with pytest.raises(BadFile, match=words):
        load_params(path)


def test_a_long_value_is_truncated_in_the_error(tmp_path: Path) -> None:
    (tmp_path / "boat.param").write_text("A," + "9" * 5000 + "\n")
    with pytest.raises(BadFile) as refused:
        load_params(tmp_path / "boat.param")
    assert len(str(refused.value)) < 400
