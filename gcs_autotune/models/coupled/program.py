"""Convert a form to the arrays that the compiled simulation uses: states, elements of the inertia matrix, terms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.derivatives import (
    DEPTH,
    FORCES,
    PAYLOAD,
    PAYLOADS,
    RIGID_BODY,
    SPECIAL,
    WALLS,
    inertia_of,
    term_of,
)
from gcs_autotune.models.coupled.form import Form
from gcs_autotune.models.coupled.kernel import Program
from gcs_autotune.sname import DOFS

__all__ = ["inertia_matrix", "program_of", "states_of"]

Array = NDArray[np.float64]

_NU = ("u", "v", "w", "p", "q", "r")
_ETA = ("x", "y", "z", "phi", "theta", "psi")


def states_of(form: Form) -> tuple[str, ...]:
    """Return the names of the states of *form*, in the order of the state vector."""
    rows = [FORCES.index(DOFS[d].force) for d in form.dofs]
    lagged = tuple(f"lagged {c}" for c in form.inputs) if "lag" in form.parameters else ()
    return (*(_ETA[i] for i in rows), *(_NU[i] for i in rows), *lagged)


def inertia_matrix(form: Form, theta: Array) -> Array:
    """Return the inertia matrix M (6, 6) for the parameters *theta*, zero outside the active degrees of freedom."""
    program = program_of(form)
    M = np.zeros((6, 6))
    for (i, j, par), coefficient in zip(program.inertia, program.inertia_coefs, strict=True):
        M[i, j] += coefficient * (theta[par] if par >= 0 else 1.0)
    return M


@lru_cache(maxsize=64)
def _program(key: tuple[Any, ...]) -> Program:
    form: Form = key[0].form
    names = form.parameters
    rows = [FORCES.index(DOFS[d].force) for d in form.dofs]
    k = len(rows)
    column = np.full(12, -1, dtype=np.int64)
    for place, d in enumerate(rows):
        column[6 + d], column[d] = place, k + place
    inertia = [e for e in _inertia_entries(form) if e[0] in rows and e[1] in rows]
    terms = _terms(form, rows)
    spatial = any(d in rows for d in (3, 4)) or (2 in rows and (0 in rows or 1 in rows))

    def where(name: str) -> int:
        return names.index(name) if name in names else -1

    return Program(
        active=np.array(rows, dtype=np.int64),
        column=column,
        rows=np.array([t[0] for t in terms], dtype=np.int64),
        pars=np.array([t[1] for t in terms], dtype=np.int64),
        scales=np.array([t[2] for t in terms], dtype=np.int64),
        coefs=np.array([t[3] for t in terms], dtype=np.float64),
        factors=np.array([t[4] for t in terms], dtype=np.int64).reshape(-1, 3),
        inertia=np.array([e[:3] for e in inertia], dtype=np.int64).reshape(-1, 3),
        inertia_coefs=np.array([e[3] for e in inertia], dtype=np.float64),
        delay=where("delay"),
        lag=where("lag"),
        current_x=where("V_x"),
        current_y=where("V_y"),
        drift_x=where("drift_x"),
        drift_y=where("drift_y"),
        reach=where("reach"),
        bottom=where("bottom"),
        payload=np.array([_payload(list(form.inputs), row) for row in PAYLOADS], dtype=np.int64),
        depth=list(form.inputs).index(DEPTH) if DEPTH in form.inputs else -1,
        coriolis=int(form.coriolis),
        spatial=int(spatial),
        m=len(form.inputs),
    )


def _payload(inputs: list[str], own: str) -> int:
    """Return the index of the input that multiplies the inertia of a row, -1 if absent. *own* acts on this row only."""
    return next((inputs.index(name) for name in (own, PAYLOAD) if name in inputs), -1)


class _Key:
    """Hashable key made of the content of a form, because a form contains mappings and is not hashable."""

    __slots__ = ("_content", "form")

    def __init__(self, form: Form) -> None:
        self.form = form
        known = tuple(form.known.items())
        inputs = tuple((c, tuple(p)) for c, p in form.inputs.items())
        self._content = (form.dofs, form.free, known, inputs, form.coriolis)

    def __hash__(self) -> int:
        return hash(self._content)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._content == other._content


def program_of(form: Form) -> Program:
    """Return *form* as the arrays that the compiled simulation uses."""
    return _program((_Key(form),))


def _terms(form: Form, rows: Sequence[int]) -> list[tuple[int, int, int, float, tuple[int, int, int]]]:
    """Return (row, parameter, second parameter, coefficient, factors) of every term, -1 for none."""
    names, inputs = form.parameters, tuple(form.inputs)
    walls = {row: names.index(name) for row, name in enumerate(WALLS) if name in names}
    terms: list[tuple[int, int, int, float, tuple[int, int, int]]] = []
    gains: set[str] = set()
    for i, channel in enumerate(inputs):
        for force, gain in form.inputs[channel]:
            row = FORCES.index(force)
            if row not in rows:
                continue
            factors = (kernel.INPUT + i, -1, -1)
            if isinstance(gain, str):
                gains.add(gain.lstrip("-"))
                sign = -1.0 if gain.startswith("-") else 1.0
                terms.append((row, names.index(gain.lstrip("-")), -1, sign, factors))
            else:
                terms.append((row, -1, -1, float(gain), factors))
    for p, name in enumerate(names):
        if name in RIGID_BODY or name in SPECIAL or name in gains or inertia_of(name) is not None:
            continue
        term = term_of(name, inputs)
        terms.append((term.row, p, -1, 1.0, _padded(term.factors)))
        drag = {term.row + kernel.NU, term.row + kernel.NU_SIZE}
        if term.row in walls and 1 <= len(term.factors) <= 2 and drag.issuperset(term.factors):
            terms.append((term.row, p, walls[term.row], 1.0, _padded((*term.factors, kernel.NEAR))))
    return terms


def _padded(factors: Sequence[int]) -> tuple[int, int, int]:
    padded = [*factors, -1, -1, -1]
    return padded[0], padded[1], padded[2]


def _inertia_entries(form: Form) -> list[tuple[int, int, int, float]]:
    """Return (row, column, parameter or -1, coefficient) of every entry of M."""
    names = form.parameters
    entries: list[tuple[int, int, int, float]] = []
    derivatives = {(i.row, i.column): p for p, n in enumerate(names) if (i := inertia_of(n)) is not None}
    for (row, column), p in derivatives.items():
        entries.append((row, column, p, -1.0))
        if row != column and (column, row) not in derivatives:
            entries.append((column, row, p, -1.0))
    for name, row, column, sign in (("I_x", 3, 3, 1.0), ("I_y", 4, 4, 1.0), ("I_z", 5, 5, 1.0)):
        if name in names:
            entries.append((row, column, names.index(name), sign))
    if "I_xz" in names:
        entries += [(3, 5, names.index("I_xz"), -1.0), (5, 3, names.index("I_xz"), -1.0)]
    if "m" in names:
        entries += [(i, i, names.index("m"), 1.0) for i in range(3)]
        # -m S(r_G) above, m S(r_G) below the diagonal; Fossen2011, (3.44).
        for name, places in (
            ("x_G", ((1, 5, 1.0), (2, 4, -1.0))),
            ("y_G", ((0, 5, -1.0), (2, 3, 1.0))),
            ("z_G", ((0, 4, 1.0), (1, 3, -1.0))),
        ):
            if name not in names:
                continue
            known = "m" in form.known
            p = names.index(name) if known else names.index("m")
            factor = form.known["m"] if known else form.known[name]
            for row, column, sign in places:
                entries += [(row, column, p, sign * factor), (column, row, p, sign * factor)]
    return entries
