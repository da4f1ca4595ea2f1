"""Derivative names: read by the table, rejected if they mean nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_autotune.errors import BadFile
from gcs_autotune.models import FORCES, STATES, inertia_of, term_of, unit_of

INPUTS = ("delta", "n")


def size(code: int) -> tuple[str, bool]:
    """Return which velocity a factor's code means and whether its magnitude."""
    return STATES[code % 6], code >= 6


@pytest.mark.parametrize(
    ("name", "row", "factors"),
    [
        ("X_u", 0, [("u", False)]),
        ("X_uu", 0, [("u", True), ("u", False)]),
        ("Y_|v|r", 1, [("v", True), ("r", False)]),
        ("N_uv", 5, [("u", False), ("v", False)]),
        ("Z_0", 2, []),
    ],
)
def test_velocity_terms_have_a_row_and_factors(name: str, row: int, factors: list[tuple[str, bool]]) -> None:
    term = term_of(name, INPUTS)
    assert term.row == row
    assert [size(c) for c in term.factors] == factors


@given(st.sampled_from(FORCES), st.lists(st.tuples(st.sampled_from(STATES), st.booleans()), min_size=1, max_size=3))
def test_explicit_products_are_read_back(force: str, factors: list[tuple[str, bool]]) -> None:
    distinct = [f for i, f in enumerate(factors) if i == 0 or f[0] != factors[i - 1][0]]
    name = f"{force}_" + "".join(f"|{s}|" if modulus else s for s, modulus in distinct)
    term = term_of(name, ())
    assert term.row == FORCES.index(force)
    assert [size(c) for c in term.factors] == distinct


@given(st.sampled_from(FORCES), st.sampled_from(STATES))
def test_added_mass_has_the_row_and_column_of_its_letters(force: str, state: str) -> None:
    inertia = inertia_of(f"{force}_{state}dot")
    assert inertia is not None
    assert (inertia.row, inertia.column) == (FORCES.index(force), STATES.index(state))


@pytest.mark.slow
@given(st.from_regex(r"[XYZKMNQ]_[uvwpqr|0a-z]{0,8}", fullmatch=True))
def test_any_other_text_is_read_or_rejected_without_a_crash(text: str) -> None:
    try:
        term = term_of(text, INPUTS)
    except BadFile:
        return
    assert 0 <= term.row < 6
    assert len(term.factors) <= 3


@pytest.mark.parametrize("name", ["X_", "Q_u", "X_b", "X_uuuu", "X_|u", "delta"])
def test_an_invalid_derivative_is_rejected(name: str) -> None:
    with pytest.raises(BadFile):
        term_of(name, INPUTS)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("X_udot", "N s^2/m"),
        ("N_rdot", "N m s^2/rad"),
        ("X_uu", "N s^2/m^2"),
        ("N_v", "N m s/m"),
        ("N_delta", "N m/rad"),
        ("m", "kg"),
        ("delay", "s"),
        ("X_0", "N"),
    ],
)
def test_each_parameter_has_its_unit(name: str, unit: str) -> None:
    assert unit_of(name, {"delta": "rad"}) == unit
