"""What coupled output error minimises: minus twice the log-likelihood, with exact derivatives.

The vector is the free parameters, then every record's free initial states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import Law
from gcs_autotune.identify.axis.residuals import Residual
from gcs_autotune.identify.coupled.free_run import simulated
from gcs_autotune.identify.least_squares import Local
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models.coupled import Form, Simulator
from gcs_autotune.models.coupled.kernel import COS_PSI, ETA, NEAR, SIN_PHI, SIN_PSI, SIN_THETA
from gcs_autotune.models.coupled.program import program_of

__all__ = ["CoupledObjective", "Limits", "free_states"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_POSITIONS = ("x", "y", "z", "phi", "theta", "psi")

REMEMBERED = 3
"""Vectors whose residuals are kept: every round of the noise begins where the one before ended."""

_HELD = 1.0
"""Standard deviation of a lagged input's first value about the input itself, in units of that input's range."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Smallest and largest value allowed per parameter name; unlimited where not named."""

    low: Mapping[str, float]
    high: Mapping[str, float]

    def of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return both (p,) in the order of *names*."""
        low = np.array([self.low.get(n, -np.inf) for n in names])
        return low, np.array([self.high.get(n, np.inf) for n in names])

    def within(self, other: Limits) -> Limits:
        """Return the limits that respect both, these first where they contradict each other."""
        low, high = dict(self.low), dict(self.high)
        for name in {*other.low, *other.high}:
            least = max(self.low.get(name, -np.inf), other.low.get(name, -np.inf))
            most = min(self.high.get(name, np.inf), other.high.get(name, np.inf))
            if least < most:
                low[name], high[name] = least, most
        return Limits(low, high)


def free_states(form: Form, record: Segment) -> tuple[str, ...]:
    """Return the initial states to fit: all that some measured signal depends on."""
    measured = set(record.signals)
    program = program_of(form)
    sines = {SIN_PHI: 3, SIN_THETA: 4, SIN_PSI: 5, COS_PSI: 5, NEAR: 2}
    codes = {int(c) for c in program.factors.ravel()}
    restoring = {sines.get(c, c - ETA) for c in codes if ETA <= c < ETA + 6 or c in sines}
    current = {"V_x", "V_y"} & set(form.parameters) and {"u", "v"} & measured
    wanted = []
    for name in Simulator(form).states:
        if name not in _POSITIONS:
            wanted.append(name)
            continue
        used = name in measured or _POSITIONS.index(name) in restoring
        if name == "psi":
            used = used or bool(current) or bool({"x", "y"} & measured)
        if name in ("phi", "theta") and program.spatial:
            used = used or bool(set(_POSITIONS) & measured)
        if used:
            wanted.append(name)
    return tuple(wanted)


@dataclass(frozen=True, slots=True, eq=False)
class CoupledObjective:
    """The cost of the *free* parameters of *form* and the initial states of *records*.

    ``theta`` (p,) all parameters in the form's order: what is not free stays; ``initial`` (n,) states per record,
    likewise. ``fixed_states``: initial states stay as given. ``patience``: steps per stamp of a simulation; what is
    stiffer is no craft whose samples these are.
    """

    form: Form
    records: tuple[Segment, ...]
    free: tuple[str, ...]
    theta: Array
    initial: tuple[Array, ...]
    fixed_states: bool = False
    patience: int = 30
    simulators: tuple[Simulator, ...] = field(init=False)
    places: Index = field(init=False)
    columns_of: tuple[Index, ...] = field(init=False)
    states_of: tuple[Index, ...] = field(init=False)
    recent: dict[bytes, list[Residual] | None] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        simulators, columns, states, used = [], [], [], len(self.free)
        for record in self.records:
            names = () if self.fixed_states else free_states(self.form, record)
            simulator = Simulator(self.form, self.free, names, patience=self.patience)
            simulators.append(simulator)
            columns.append(np.concatenate([np.arange(len(self.free)), used + np.arange(len(names))]))
            states.append(np.array([simulator.states.index(n) for n in names], dtype=np.int64))
            used += len(names)
        places = np.array([self.form.parameters.index(n) for n in self.free], dtype=np.int64)
        for name, value in (
            ("simulators", tuple(simulators)),
            ("columns_of", tuple(columns)),
            ("states_of", tuple(states)),
            ("places", places),
        ):
            object.__setattr__(self, name, value)

    @property
    def size(self) -> int:
        """Length of the vector."""
        return len(self.free) + sum(len(s) for s in self.states_of)

    def pack(self) -> Array:
        """Return the vector of ``theta`` and ``initial``."""
        starts = [x_0[at] for x_0, at in zip(self.initial, self.states_of, strict=True)]
        return np.concatenate([self.theta[self.places], *starts])

    def unpack(self, x: Array) -> tuple[Array, tuple[Array, ...]]:
        """Undo :meth:`pack`: all parameters, and all initial states per record."""
        theta = self.theta.copy()
        theta[self.places] = x[: len(self.free)]
        initial = []
        for x_0, at, columns in zip(self.initial, self.states_of, self.columns_of, strict=True):
            mine = x_0.copy()
            mine[at] = x[columns[len(self.free) :]]
            initial.append(mine)
        return theta, tuple(initial)

    def limits(self, limits: Limits) -> tuple[Array, Array]:
        """Return the smallest and the largest vector allowed."""
        low, high = limits.of(self.free)
        states = np.full(self.size - len(self.free), np.inf)
        return np.concatenate([low, -states]), np.concatenate([high, states])

    def residuals(self, x: Array) -> list[Residual] | None:
        """Return the residuals, Jacobians in the record's own columns; None when a simulation runs away."""
        key = x.tobytes()
        if key not in self.recent:
            while len(self.recent) >= REMEMBERED:
                del self.recent[next(iter(self.recent))]
            self.recent[key] = self._simulated(x)
        return self.recent[key]

    def _simulated(self, x: Array) -> list[Residual] | None:
        theta, initial = self.unpack(x)
        found = []
        for i, record in enumerate(self.records):
            motion = simulated(self.simulators[i], theta, initial[i], record)
            if motion is None:
                return None
            for name, (value, by) in motion.items():
                signal = record.signals[name]
                found.append(Residual(i, signal, signal.values - value, by))
        return found

    def at(self, x: Array, laws: Mapping[str, Law]) -> Local | None:
        """Return cost, gradient and curvature, None when a simulation runs away."""
        found = self.residuals(x)
        if found is None:
            return None
        cost, gradient, curvature = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
        for residual in found:
            terms, J, own = (
                laws[residual.signal.name].terms(residual.error),
                residual.jacobian,
                self.columns_of[residual.record],
            )
            cost += float(terms.deviance.sum())
            gradient[own] -= J.T @ terms.slope
            curvature[np.ix_(own, own)] += J.T @ (terms.curvature[:, None] * J)
        prior, weight = self.known()
        off = x - prior
        return Local(cost + float(weight @ off**2), gradient + weight * off, curvature + np.diag(weight))

    def known(self) -> tuple[Array, Array]:
        """Return what is known before the data: expected value and information of each element of the vector.

        Only of lagged inputs: each begins near the input in force at the start.
        """
        prior, weight = np.zeros(self.size), np.zeros(self.size)
        for i, record in enumerate(self.records):
            names = self.simulators[i].free_states
            for name, at in zip(names, self.columns_of[i][len(self.free) :], strict=True):
                if name.startswith("lagged "):
                    channel = list(self.form.inputs).index(name.removeprefix("lagged "))
                    own = record.inputs[:, channel]
                    prior[at] = first_input(record)[channel]
                    weight[at] = (_HELD * max(float(np.ptp(own)), 1e-9)) ** -2
        return prior, weight

    def columns(self, residual: Residual) -> Array:
        """Return a residual's Jacobian (n, size) in the columns of the whole vector."""
        wide = np.zeros((len(residual.error), self.size))
        wide[:, self.columns_of[residual.record]] = residual.jacobian
        return wide


def first_input(record: Segment) -> Array:
    """Return the inputs (m,) in force at the record's start."""
    row = int(np.searchsorted(record.t_in, record.start, side="right")) - 1
    first: Array = record.inputs[max(row, 0)]
    return first
