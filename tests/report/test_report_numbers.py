"""Formatting of numbers."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs_autotune.report.toolkit.wording import (
    format_change,
    format_moment,
    format_number,
    format_percent,
    format_quantity,
    format_seconds,
    format_value,
    pretty_unit,
)
from gcs_autotune.rounding import format_digits, rounded_to

VALUES = st.floats(-1e9, 1e9, allow_subnormal=False)
ERRORS = st.floats(1e-12, 1e9)


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.030412, 0.00021, "0.0304 ± 0.0002"),
        (0.030412, 0.00012, "0.03041 ± 0.00012"),
        (0.5, 0.000996, "0.5000 ± 0.0010"),
        (84231.0, 523.0, "84200 ± 500"),
        (-0.004, 0.03, "0.00 ± 0.03"),
        (-12.34, 0.3, "-12.3 ± 0.3"),
        (2.2554e-9, 3.1e-11, "(2.26 ± 0.03)e-9"),
        (0.2, 0.0, "0.2"),
        (4.4999999999999991, 1.3e-15, "4.5"),
        (-12345.678912, 4e-12, "-12345.6789"),
        (4.4999999999999991, 2e-8, "4.50000000 ± 0.00000002"),
        (0.2, 5e-324, "0.2"),
        (1e300, 2e290, "(1.0000000000 ± 0.0000000002)e300"),
        (0.2, -1.0, "0.2 ± ?"),
        (0.2, math.inf, "0.2 ± ?"),
        (0.2, math.nan, "0.2 ± ?"),
        (math.nan, 0.1, "?"),
    ],
)
def test_a_value_is_rounded_to_its_uncertainty(value, std, text):
    assert format_value(value, std) == text


def _read_back(text: str) -> tuple[float, float, float]:
    """Return value, error and the weight of the last digit shown."""
    power = re.search(r"\)e(-?\d+)$", text)
    scale = 10.0 ** int(power[1]) if power else 1.0
    value, std = re.sub(r"\)e.*$", "", text).strip("(").split(" ± ")
    decimals = len(value.partition(".")[2])
    last = 10.0**-decimals if decimals else 10.0 ** (len(std) - len(std.rstrip("0")))
    return scale * float(value), scale * float(std), scale * last


@given(VALUES, ERRORS)
def test_rounding_never_moves_a_value_by_more_than_a_third_of_its_error(value, std):
    assume(std > 1e-12 * abs(value))
    shown, _, _ = _read_back(format_value(value, std))
    assert abs(shown - value) <= 0.34 * std + 1e-12 * abs(value)


@given(VALUES, ERRORS)
def test_the_shown_error_is_within_a_quarter_of_the_true_one(value, std):
    assume(std > 1e-12 * abs(value))
    _, shown, _ = _read_back(format_value(value, std))
    assert abs(shown - std) <= 0.25 * std


@given(VALUES, ERRORS)
def test_value_and_error_have_the_same_last_digit_set_by_the_error(value, std):
    assume(std > 1e-12 * abs(value))
    text = re.sub(r"\)e.*$", "", format_value(value, std)).strip("(")
    left, right = text.split(" ± ")
    assert len(left.partition(".")[2]) == len(right.partition(".")[2])
    assert len(right.replace(".", "").strip("0")) <= 2


@given(st.floats(-1e6, 1e6, exclude_min=True, exclude_max=True, allow_subnormal=False))
def test_no_number_is_shown_as_minus_zero(value):
    for text in (format_value(value, 0.5), format_number(value), format_percent(value), format_seconds(value)):
        assert not re.match(r"-0(\.0*)?( |$)", text)


@pytest.mark.parametrize(
    ("t", "text"),
    [(0.52, "0.52 s"), (6.2, "6.2 s"), (59.97, "1 min 00 s"), (125.0, "2 min 05 s"), (math.inf, "unlimited")],
)
def test_seconds_are_formatted_by_magnitude(t, text):
    assert format_seconds(t) == text


def test_a_time_that_was_never_reached_is_called_never():
    assert format_seconds(math.nan, "never") == "never"


def test_a_large_number_is_not_shown_as_a_power_of_ten():
    assert format_quantity(math.radians(103.0), "rad", 2) == "100°"
    assert [format_number(v, 2) for v in (-123456.0, 0.000123, 2.5e7)] == ["-120000", "0.00012", "2.5e+07"]


def test_numbers_of_a_column_have_the_same_significant_digits():
    assert [format_digits(v, 3) for v in (1.2, 0.953, 193.0, 9.996, -0.05)] == [
        "1.20",
        "0.953",
        "193",
        "10.0",
        "-0.0500",
    ]
    assert [format_digits(v, 3) for v in (0.0, math.nan, math.inf)] == ["0", "?", "unlimited"]


def test_angles_are_shown_in_degrees_and_lengths_in_metres():
    assert format_quantity(0.5, "rad") == "28.6°"
    assert format_quantity(0.5, "rad/s") == "28.6°/s"
    assert format_quantity(0.5, "m") == "0.5 m"
    assert format_quantity(math.nan, "m") == "?"


def test_changes_are_relative_and_empty_where_undefined():
    assert format_change(9.8, 3.1) == "-68 %"
    assert format_change(1.0, 1.001) == "no change"
    assert format_change(0.0, 1.0) == ""
    assert format_change(1.0, math.nan) == ""
    assert format_change(0.01, 5.0) == "x 500"


def test_units_and_times_are_written_readably():
    assert pretty_unit("N m s^2/rad^2") == "N m s²/rad²"
    assert pretty_unit("1 s^2/(m rad)") == "s²/(m rad)"
    assert format_moment("2026-11-20T20:12:09+00:00") == "2026-11-20 20:12 UTC"
    assert format_moment("yesterday") == "yesterday"


def test_a_small_value_alone_keeps_its_power_of_ten() -> None:
    assert rounded_to(-0.00051792, 2e-8) == "-5.1792e-4"
    assert rounded_to(6.9312, 0.17) == "6.93"
