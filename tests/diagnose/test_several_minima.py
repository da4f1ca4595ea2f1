"""The likelihood of an effect with a place or direction has several minima, and the deepest one counts."""

from __future__ import annotations

import pytest

from benchmarks.blind.case import draw_case
from gcs_autotune.diagnose.candidates import candidates, fitted_roughly, fitted_to_the_end, screen
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded


def test_the_nearer_of_two_walls_that_fit_almost_equally_is_found() -> None:
    """The wall on the other side fits worse by 5.5 nats only, and predicts another run six times worse."""
    case = draw_case("environment", 62, 1, "bank-suction")
    form = plain_form(case.runs)
    problem, base = fit_base(form, prepare_as_recorded(case.runs, form)[0])
    (candidate,) = screen(problem, [base], [], candidates(problem.data_summary, (), ["bank-suction"]))
    rough = fitted_roughly(problem, candidate)
    assert rough is not None
    wall = fitted_to_the_end(problem, candidate, rough).own(candidate.effect)
    _, true = case.truth["bank-suction"]
    assert wall["direction"] == pytest.approx(true["direction"], abs=0.2)
    assert wall["distance"] == pytest.approx(true["distance"], abs=0.3)
