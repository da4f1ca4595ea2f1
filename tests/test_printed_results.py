"""Every result that a public function returns prints as a short report, not as the code that makes it."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune.api import design, example_run, fit
from gcs_autotune.identify import model_file_of
from gcs_autotune.identify.frequency.nomoto import NomotoFit
from gcs_autotune.models import Nomoto1
from gcs_autotune.notebook import WIDTH, Displayed, display_of_fields, parameter_tables

ROOMS = (
    *("api", "identify", "diagnose", "design", "control", "experiments", "models", "effects", "navigation"),
    *("seatrials", "thrusters", "vision", "crosscheck", "identify.frequency", "identify.relay", "identify.plan"),
)
"""Rooms whose functions are called at the desk."""
ELSEWHERE = ("gcs_autotune.logs", "gcs_autotune.report")
"""Rooms whose classes are stores and pages, not results."""


def results():
    """Yield the dataclasses that the public functions of :data:`ROOMS` return."""
    seen = set()
    for room in ROOMS:
        module = importlib.import_module(f"gcs_autotune.{room}")
        for function in filter(inspect.isfunction, map(module.__dict__.get, module.__all__)):
            inside = vars(inspect.getmodule(inspect.unwrap(function)))
            for word in re.findall(r"\w+", str(function.__annotations__.get("return", ""))):
                found = inside.get(word)
                if dataclasses.is_dataclass(found) and found not in seen and not found.__module__.startswith(ELSEWHERE):
                    seen.add(found)
                    yield found


def test_every_result_has_a_display() -> None:
    found = list(results())
    assert len(found) > 50
    assert [c.__name__ for c in found if not issubclass(c, Displayed) and c.__str__ is object.__str__] == []


def test_a_model_file_prints_its_numbers_with_their_errors() -> None:
    reported = str(model_file_of(fit(example_run(), "linear", dof="yaw", delay=0.0)))
    assert reported.startswith("Model file 'output-error': yaw, linear damping; inputs N [1]")
    assert re.search(r"N_r +-0\.50\d+ ± 0\.000\d +0\.1 % +s/rad +fitted", reported)


def test_a_small_relative_error_is_not_shown_as_zero() -> None:
    values = {n: SimpleNamespace(value=1.0, std=s, unit="s", status="fitted") for n, s in (("a", 1e-4), ("b", 6e-4))}
    table = parameter_tables(values, np.diag([1e-8, 3.6e-7]))[0]
    assert [row[2] for row in table.rows] == ["< 0.1 %", "0.1 %"]


def test_a_nomoto_fit_prints_gain_and_time_constant_with_their_errors() -> None:
    found = NomotoFit(Nomoto1(0.2, 4.0), {"K": 0.01, "T": 0.3, "delay": 0.0}, np.ones(3), np.eye(3), 0.02, 1.0)
    reported = str(found)
    assert reported.startswith("Nomoto model of first order; 2.0% of the motion is not explained")
    assert "K          0.200 ± 0.010           velocity per input" in reported
    assert "NomotoFit(" not in reported


def test_fields_are_shown_with_the_units_and_meanings_of_the_docstring() -> None:
    proposal = design(
        fit(example_run(), "linear", dof="yaw", delay=0.0),
        "heading",
        {"ATC_STR_ANG_P": 2.0, **{f"ATC_STR_RAT_{term}": 0.1 for term in ("FF", "P", "I", "D")}},
        speed=1.5,
    )
    reported = str(proposal.after.metrics)
    assert reported.startswith("StepMetrics: Metrics of a step.")
    assert re.search(r"itae +[\d.]+ +\[s\^2\] integral of time times absolute error", reported)
    for result in (proposal.margins, proposal.changes[0], proposal.after, proposal.actuator):
        lines = str(result).splitlines()
        assert not lines[0].startswith(f"{type(result).__name__}(")
        assert max(map(len, lines)) <= WIDTH


@pytest.mark.parametrize(("value", "shown"), [(None, "none"), (True, "yes"), (0.25, "0.25"), ((1.0, 2.0), "1, 2")])
def test_a_value_is_shown_in_plain_notation(value: object, shown: str) -> None:
    @dataclasses.dataclass(frozen=True)
    class Thing:
        """A thing."""

        value: object

    (table,) = display_of_fields(Thing(value)).tables
    assert table.rows == (("value", shown),)


def test_parts_of_one_type_are_the_rows_of_a_table() -> None:
    @dataclasses.dataclass(frozen=True)
    class Part:
        """A part."""

        size: float

    @dataclasses.dataclass(frozen=True)
    class Whole:
        """A whole.

        - ``parts``: its parts.
        """

        parts: tuple[Part, ...]

    (table,) = display_of_fields(Whole((Part(1.0), Part(2.5)))).tables
    assert table.heads == ("parts", "size")
    assert table.rows == (("1", "1"), ("2", "2.5"))
