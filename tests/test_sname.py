"""The notation: a case for every unit, column headers, and angles."""

from __future__ import annotations

import math

import pytest

from gcs_autotune import sname
from gcs_autotune.errors import BadFile
from gcs_autotune.sname import DOFS, SIGNALS, column_unit, parse_header, to_si, wrap

CASES = {
    "": ("1", 1.0),
    "1": ("1", 1.0),
    "-": ("1", 1.0),
    "%": ("1", 0.01),
    "s": ("s", 1.0),
    "ms": ("s", 0.001),
    "us": ("s", 0.000001),
    "ns": ("s", 0.000000001),
    "min": ("s", 60.0),
    "km": ("m", 1000.0),
    "mm/s": ("m/s", 0.001),
    "deg/min": ("rad/s", 0.0002908882086657216),
    "1/s": ("rad/s", 6.283185307179586),
    "1/min": ("rad/s", 0.10471975511965977),
    "mN m": ("N m", 0.001),
    "m": ("m", 1.0),
    "cm": ("m", 0.01),
    "mm": ("m", 0.001),
    "rad": ("rad", 1.0),
    "deg": ("rad", 0.017453292519943295),
    "m/s": ("m/s", 1.0),
    "cm/s": ("m/s", 0.01),
    "kn": ("m/s", 0.5144444444444445),
    "km/h": ("m/s", 0.2777777777777778),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", 0.017453292519943295),
    "rev/s": ("rad/s", 6.283185307179586),
    "rpm": ("rad/s", 0.10471975511965977),
    "m/s^2": ("m/s^2", 1.0),
    "rad/s^2": ("rad/s^2", 1.0),
    "deg/s^2": ("rad/s^2", 0.017453292519943295),
    "N": ("N", 1.0),
    "kN": ("N", 1000.0),
    "kgf": ("N", 9.80665),
    "N m": ("N m", 1.0),
    "Nm": ("N m", 1.0),
    "kN m": ("N m", 1000.0),
    "V": ("V", 1.0),
    "A": ("A", 1.0),
    "Pa": ("Pa", 1.0),
    "hPa": ("Pa", 100.0),
    "pwm": ("pwm", 1.0),
    "count": ("count", 1.0),
}


@pytest.mark.parametrize("unit", CASES)
def test_every_unit_is_converted_to_si(unit: str) -> None:
    assert to_si(unit) == (CASES[unit][0], pytest.approx(CASES[unit][1], rel=1e-15))
    assert to_si(f" {unit} ") == to_si(unit)


def test_every_unit_has_a_test_case() -> None:
    assert set(sname._TO_SI) == set(CASES)


def test_the_degree_sign_is_accepted_and_an_unknown_unit_is_rejected_with_a_list() -> None:
    assert to_si("°/s") == to_si("deg/s")
    with pytest.raises(BadFile, match=r"unit \[furlong\] is unknown. Known units: .*rpm"):
        to_si("furlong")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("N*m", "N m"), ("N.m", "N m"), ("N·m", "N m"), ("kNm", "kN m"), ("rev/min", "rpm"), ("RPM", "rpm"),
        ("r/min", "rpm"), ("rps", "rev/s"), ("s^-1", "1/s"), ("Hz", "1/s"), ("rad*s^-1", "rad/s"), ("rad s-1", "rad/s"),
        ("m s^-2", "m/s^2"), ("m/s²", "m/s^2"), ("m/s/s", "m/s^2"), ("m/s**2", "m/s^2"), ("deg/sec", "deg/s"),
        ("degrees", "deg"), ("radians", "rad"), ("seconds", "s"), ("nsec", "ns"), ("nanoseconds", "ns"), ("µs", "us"),
        ("knots", "kn"), ("metres", "m"),
    ],
)  # fmt: skip
def test_units_are_understood_in_the_spelling_of_ros_and_others(written: str, meant: str) -> None:
    assert to_si(written) == to_si(meant)


@pytest.mark.parametrize(
    ("name", "unit", "si"),
    [
        ("n", "1/s", ("rad/s", 2.0 * math.pi)),
        ("n_left", "1/min", ("rad/s", math.pi / 30.0)),
        ("r", "1/s", ("rad/s", 1.0)),
        ("nav_rate", "1/s", ("1/s", 1.0)),
        ("temperature", "degC", ("degC", 1.0)),
        ("N", "us", ("pwm", 1.0)),
    ],
)
def test_the_meaning_of_a_unit_depends_on_the_column(name: str, unit: str, si: tuple[str, float]) -> None:
    assert column_unit(name, unit) == (si[0], pytest.approx(si[1]))


@pytest.mark.parametrize("name", ["psi", "N", "force_left", "delta_2"])
def test_a_signal_in_an_unknown_unit_is_rejected(name: str) -> None:
    with pytest.raises(BadFile, match=r"unit \[furlong\] is unknown"):
        column_unit(name, "furlong")


@pytest.mark.parametrize(
    ("name", "unit", "si"),
    [("pwm1", "us", "pwm"), ("SERVO3", "µs", "pwm"), ("rc4", " us ", "pwm"), ("t", "us", "s"), ("rc4", "ms", "s")],
)
def test_microseconds_of_a_pulse_are_not_a_time(name: str, unit: str, si: str) -> None:
    assert column_unit(name, unit)[0] == si


@pytest.mark.parametrize(
    ("name", "si"), [("delta", "rad"), ("psi", "rad"), ("u", "m/s"), ("N", "1"), ("X", "1"), ("battery", "1")]
)
def test_a_column_without_a_unit_has_that_of_its_signal_or_is_normalised_output(name: str, si: str) -> None:
    assert column_unit(name, "") == (si, 1.0)
    assert column_unit(name, "1") == ("1", 1.0)


@pytest.mark.parametrize(
    ("head", "parts"),
    [
        ("psi[deg]", ("psi", "deg")),
        (" N [N m] ", ("N", "N m")),
        ("psi", ("psi", "")),
        ("n[]", ("n", "")),
        ("psi (deg)", ("psi", "deg")),
        ("Speed(m/s)", ("Speed", "m/s")),
        ("heading (°)", ("heading", "°")),
        ("heading (raw)", ("heading (raw)", "")),
        ("n[1/s]", ("n", "1/s")),
        ("[n[1/s]]", ("n", "1/s")),
        ("tau_z [N*m]", ("tau_z", "N*m")),
    ],
)
def test_a_header_is_a_name_and_a_unit(head: str, parts: tuple[str, str]) -> None:
    assert parse_header(head) == parts


@pytest.mark.parametrize("head", ["", "[deg]", "psi[deg", "psi]deg[", "psi[deg] x"])
def test_an_invalid_header_is_rejected(head: str) -> None:
    with pytest.raises(BadFile, match="is not name"):
        parse_header(head)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (4.0, 4.0 - math.tau),
        (-4.0, math.tau - 4.0),
        (7.0, 7.0 - math.tau),
    ],
)
def test_an_angle_is_wrapped_to_half_a_turn_on_either_side(angle: float, wrapped: float) -> None:
    assert wrap(angle) == pytest.approx(wrapped)


@pytest.mark.parametrize("name", DOFS)
def test_signals_and_units_of_a_degree_of_freedom_match_the_table(name: str) -> None:
    dof = DOFS[name]
    force_unit, length = ("N m", "rad") if dof.angular else ("N", "m")
    assert SIGNALS[dof.position][0] == dof.position_unit == length
    assert SIGNALS[dof.velocity][0] == f"{length}/s"
    assert SIGNALS[dof.force][0] == force_unit
    nu = dof.velocity
    assert dof.parameter_names() == (f"alpha_{nu}", f"beta_{nu}", f"beta_{nu}{nu}", "delta")
    base = f"{force_unit} s"
    assert dof.parameter_units(force_unit) == (
        f"{base}^2/{length}",
        f"{base}/{length}",
        f"{base}^2/{length}^2",
        force_unit,
    )
    assert dof.parameter_units("1") == (f"s^2/{length}", f"s/{length}", f"s^2/{length}^2", "1")
