"""A form with numbers: matrices, simulation, and simulation with sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.compass import COEFFICIENTS, seen_by_compass
from gcs_autotune.models.coupled.derivatives import FORCES, RIGID_BODY, SPECIAL, inertia_of, term_of
from gcs_autotune.models.coupled.form import Form, form_from
from gcs_autotune.models.coupled.kernel import Program
from gcs_autotune.sname import DOFS

__all__ = ["SCHEMA", "CoupledModel", "CoupledMotion", "Simulator"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SCHEMA = 1

_NU = ("u", "v", "w", "p", "q", "r")
_ETA = ("x", "y", "z", "phi", "theta", "psi")

PACES = 2.0 ** (np.arange(-8, 41) / 2.0)
"""Rates [1/s] a simulation's step may be made for: a fixed ladder, so that nearby parameters take the same steps."""


TRIES, FINER = 4, 8.0
"""A motion that runs away is tried again with steps this much shorter, as steps too long run away by themselves."""

PATIENCE, STEPS = 70, 2000
"""Steps per stamp, and so many more for a short run, that a simulation may take."""

SLACK = 0.2
"""A simulation far slower than its steps, in shares of their pace, lets the next one take longer steps again."""


@dataclass(frozen=True, slots=True, eq=False)
class CoupledMotion:
    """A simulated run: ``values[signal]`` (s,) at the stamps asked for, ``finite`` False when it ran away.

    ``by[signal]`` (s, q): derivatives by the free parameters, then by the free initial states; empty if not asked.
    """

    values: Mapping[str, Array]
    by: Mapping[str, Array]
    finite: bool


class Simulator:
    """A form made ready to run, for one choice of free parameters and free initial states.

    Parameters
    ----------
    free : names of the parameters sensitivities are wanted for, in this order.
    free_states : names of the initial states (``u``, ``psi``, ``x`` ...) likewise; they come after the parameters.
    patience : steps per stamp before a simulation is given up as hopelessly stiff.
    """

    def __init__(
        self,
        form: Form,
        free: Sequence[str] = (),
        free_states: Sequence[str] = (),
        *,
        patience: int = PATIENCE,
    ) -> None:
        self.patience = patience
        self.form = form
        self.free = tuple(free)
        self.free_states = tuple(free_states)
        self.program = program_of(form)
        names = form.parameters
        self._free = np.array([self.free.index(n) if n in self.free else -1 for n in names], dtype=np.int64)
        self._states = np.array(
            [len(self.free) + self.free_states.index(n) if n in self.free_states else -1 for n in self.states],
            dtype=np.int64,
        )
        self._none = np.full_like(self._free, -1)
        self._pace = 1.0

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the state vector: positions, velocities, then lagged inputs if there is a lag."""
        return states_of(self.form)

    def matrices(self, theta: Array) -> tuple[Array, Array]:
        """Return M (6, 6) and the inverse (k, k) of its active part; ``LinAlgError`` when it has none."""
        M = inertia_matrix(self.form, theta)
        active = self.program.active
        return M, np.ascontiguousarray(np.linalg.inv(M[np.ix_(active, active)]))

    def run(
        self, theta: Array, x_0: Array, t_in: Array, inputs: Array, t_out: Array, *, sensitivities: bool = True
    ) -> tuple[Array, Array] | None:
        """Simulate; None when the motion runs away or M is singular.

        Parameters
        ----------
        theta : (p,) in the order of ``form.parameters``. x_0 : (n,) state at ``t_out[0]``.
        t_in, inputs : (j,), (j, m) each row holds from its stamp on, the first also before it.
        t_out : (s,) non-decreasing stamps.

        Returns
        -------
        X (s, n) and S (s, n, q); S is (0, 0, 0) without *sensitivities*.
        """
        try:
            M, M_inverse = self.matrices(theta)
        except np.linalg.LinAlgError:
            return None
        n, q = len(self.states), len(self.free) + len(self.free_states)
        X = np.empty((len(t_out), n))
        S = np.empty((len(t_out), n, q)) if sensitivities else np.empty((0, 0, 0))
        for _ in range(TRIES if self.patience >= PATIENCE else 2):
            finite, fastest = kernel.sweep(
                self.program,
                np.asarray(theta, dtype=np.float64),
                M,
                M_inverse,
                np.asarray(x_0, dtype=np.float64),
                np.ascontiguousarray(t_in, dtype=np.float64),
                np.ascontiguousarray(inputs, dtype=np.float64),
                np.ascontiguousarray(t_out, dtype=np.float64),
                self._free if sensitivities else self._none,
                self._states,
                q if sensitivities else 1,
                sensitivities,
                self._pace,
                STEPS + self.patience * len(t_out),
                X,
                S,
            )
            if fastest <= self._pace:
                break
            self._pace = _pace(fastest if finite else min(fastest, FINER * self._pace))
        enough = finite and fastest <= self._pace
        if fastest < SLACK * self._pace or not enough:
            self._pace = _pace(fastest) if enough else 1.0
        return (X, S) if enough else None

    def outputs(self, theta: Array, X: Array, S: Array, signal: str) -> tuple[Array, Array]:
        """Return one signal (s,) and its sensitivities (s, q) from what :meth:`run` gave.

        Velocities are over ground: a current is added to those through the water. With a deviating compass they and the
        heading are as it shows them, see :mod:`.compass`.
        """
        deviation = {n: i for i, n in enumerate(self.form.parameters) if n in COEFFICIENTS}
        if not deviation or signal not in ("u", "v", "psi") or "psi" not in self.states:
            return self._over_ground(theta, X, S, signal)
        still = (np.zeros(len(X)), np.zeros((len(X), S.shape[2] if len(S) else 0)))
        wanted = ("psi",) if signal == "psi" else ("psi", "u", "v")
        true = {n: self._over_ground(theta, X, S, n) if n in self.states else still for n in wanted}
        columns = {n: self.free.index(n) for n in deviation if n in self.free}
        return seen_by_compass(signal, true, {n: float(theta[i]) for n, i in deviation.items()}, columns)

    def _over_ground(self, theta: Array, X: Array, S: Array, signal: str) -> tuple[Array, Array]:
        names = self.states
        value, by = X[:, names.index(signal)], S[:, names.index(signal)] if len(S) else np.empty((len(X), 0))
        current = [n for n in ("V_x", "V_y") if n in self.form.parameters]
        if signal not in ("u", "v") or not current:
            return value, by
        psi = X[:, names.index("psi")] if "psi" in names else np.zeros(len(X))
        by_psi = S[:, names.index("psi")] if len(S) and "psi" in names else None
        value, by = value.copy(), by.copy()
        for name in current:
            speed = float(theta[self.form.parameters.index(name)])
            along = name == "V_x"
            if signal == "u":
                share, slope = (np.cos(psi), -np.sin(psi)) if along else (np.sin(psi), np.cos(psi))
            else:
                share, slope = (-np.sin(psi), -np.cos(psi)) if along else (np.cos(psi), -np.sin(psi))
            value += speed * share
            if by_psi is not None:
                by += speed * slope[:, None] * by_psi
            if len(S) and name in self.free:
                by[:, self.free.index(name)] += share
        return value, by


@dataclass(frozen=True, slots=True)
class CoupledModel:
    """An identified (or assumed) model of several degrees of freedom: a form and a value per parameter."""

    form: Form
    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        """Return a parameter's value; 0 for a derivative the form does not have."""
        return float(self.values.get(name, self.form.known.get(name, 0.0)))

    @property
    def theta(self) -> Array:
        """The values (p,) in the order of ``form.parameters``."""
        return np.array([self[n] for n in self.form.parameters])

    @property
    def inertia(self) -> Array:
        """M = M_RB + M_A of the active degrees of freedom (k, k)."""
        active = program_of(self.form).active
        M: Array = inertia_matrix(self.form, self.theta)[np.ix_(active, active)]
        return M

    @property
    def linear_damping(self) -> Array:
        """D (k, k), positive where it damps: minus the linear derivatives."""
        rows = [FORCES.index(DOFS[d].force) for d in self.form.dofs]
        return np.array([[-self[f"{FORCES[i]}_{_NU[j]}"] for j in rows] for i in rows])

    def simulate(
        self, t_in: Array, inputs: Mapping[str, Array], t_out: Array, initial: Mapping[str, float] | None = None
    ) -> CoupledMotion:
        """Simulate from *initial* states (0 where not given) at ``t_out[0]``; see :meth:`Simulator.run`."""
        simulator = Simulator(self.form)
        columns = [np.asarray(inputs[n], dtype=np.float64) for n in self.form.inputs]
        table = np.column_stack(columns) if columns else np.zeros((len(t_in), 0))
        x_0 = np.array([(initial or {}).get(n, 0.0) for n in simulator.states])
        found = simulator.run(self.theta, x_0, t_in, table, t_out)
        names = [s for s in simulator.states if s in _NU or s in _ETA]
        if found is None:
            return CoupledMotion({n: np.full(len(t_out), math.nan) for n in names}, {}, False)
        X, S = found
        return CoupledMotion({n: simulator.outputs(self.theta, X, S, n)[0] for n in names}, {}, True)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for a model file."""
        form = self.form
        return {
            "schema": SCHEMA,
            "model": "coupled",
            "form": {
                "name": form.name,
                "title": form.title,
                "dofs": list(form.dofs),
                "free": list(form.free),
                "known": dict(form.known),
                "inputs": {c: dict(pairs) for c, pairs in form.inputs.items()},
                "coriolis": form.coriolis,
                "normalised": form.normalised,
                "start": dict(form.start),
                "optional": list(form.optional),
            },
            "values": {n: self[n] for n in form.parameters},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CoupledModel:
        """Rebuild from :meth:`to_dict`."""
        form = form_from(data["form"], "model file")
        return cls(form, {str(k): float(v) for k, v in data["values"].items()})

    def with_values(self, values: Mapping[str, float]) -> CoupledModel:
        """Return the model with some values replaced."""
        return replace(self, values={**self.values, **values})


def _pace(fastest: float) -> float:
    """Return the rung of the ladder for a fastest rate [1/s]."""
    return max(1.0, float(PACES[min(int(np.searchsorted(PACES, 1.2 * fastest)), len(PACES) - 1)]))


def states_of(form: Form) -> tuple[str, ...]:
    """Return the names of the state vector of *form*."""
    rows = [FORCES.index(DOFS[d].force) for d in form.dofs]
    lagged = tuple(f"lagged {c}" for c in form.inputs) if "lag" in form.parameters else ()
    return (*(_ETA[i] for i in rows), *(_NU[i] for i in rows), *lagged)


def inertia_matrix(form: Form, theta: Array) -> Array:
    """Return M (6, 6), zero outside the active degrees of freedom."""
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
        coefs=np.array([t[2] for t in terms], dtype=np.float64),
        factors=np.array([t[3] for t in terms], dtype=np.int64).reshape(-1, 3),
        inertia=np.array([e[:3] for e in inertia], dtype=np.int64).reshape(-1, 3),
        inertia_coefs=np.array([e[3] for e in inertia], dtype=np.float64),
        delay=where("delay"),
        lag=where("lag"),
        current_x=where("V_x"),
        current_y=where("V_y"),
        coriolis=int(form.coriolis),
        spatial=int(spatial),
        m=len(form.inputs),
    )


class _Key:
    """Forms hold mappings and cannot be hashed; their content can."""

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
    """Return the arrays the kernel runs."""
    return _program((_Key(form),))


def _terms(form: Form, rows: Sequence[int]) -> list[tuple[int, int, float, tuple[int, int, int]]]:
    names, inputs = form.parameters, tuple(form.inputs)
    terms: list[tuple[int, int, float, tuple[int, int, int]]] = []
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
                terms.append((row, names.index(gain.lstrip("-")), sign, factors))
            else:
                terms.append((row, -1, float(gain), factors))
    for p, name in enumerate(names):
        if name in RIGID_BODY or name in SPECIAL or name in gains or inertia_of(name) is not None:
            continue
        term = term_of(name, inputs)
        padded = [*term.factors, -1, -1, -1][:3]
        terms.append((term.row, p, 1.0, (padded[0], padded[1], padded[2])))
    return terms


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
        # -m S(r_G) above, m S(r_G) below the diagonal; Fossen 2011, (3.44).
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
