"""A form with values: its matrices, and its simulation with or without sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import spend
from gcs_autotune.documents import conformed
from gcs_autotune.errors import BadFile
from gcs_autotune.models.coupled import kernel
from gcs_autotune.models.coupled.compass import COEFFICIENTS, seen_by_compass
from gcs_autotune.models.coupled.derivatives import FORCES
from gcs_autotune.models.coupled.form import Form, form_of
from gcs_autotune.models.coupled.lever_arm import LEVER_ARM, SHOWN_OFF_CENTRE, seen_off_centre
from gcs_autotune.models.coupled.linear_kernel import linear_program_of, linear_sweep
from gcs_autotune.models.coupled.program import inertia_matrix, program_of, states_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import DOFS
from gcs_autotune_files.model import CoupledData

__all__ = ["SCHEMA", "CoupledModel", "CoupledMotion", "Simulator"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SCHEMA = 1

_NU = ("u", "v", "w", "p", "q", "r")
_ETA = ("x", "y", "z", "phi", "theta", "psi")

PACES = 2.0 ** (np.arange(-8, 41) / 2.0)
"""Rates [1/s] for which the steps of a simulation may be chosen.

They are fixed, so that simulations with similar parameters take the same steps. Project choice.
"""


TRIES, FINER = 4, 8.0
"""Number of attempts for a diverging motion, and factor by which the steps of each attempt are shorter.

Project choice. Steps that are too long cause divergence by themselves.
"""

PATIENCE, STEPS = 70, 2000
"""Maximum number of steps of a simulation: per stamp (PATIENCE), and additional steps for a short run (STEPS).

Project choice.
"""

HOPELESS = 1.000001
"""Number of steps needed, relative to the maximum, above which a simulation is not started. Project choice."""

SLACK = 0.2
"""Fastest rate of a motion, relative to the rate for which its steps were chosen, below which the next simulation
may take longer steps. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CoupledMotion:
    """A simulated run.

    - ``values[signal]`` (s,): signal at the requested stamps.
    - ``by[signal]`` (s, q): derivatives by the free parameters, then by the free initial states; empty if not
      requested.
    - ``finite``: whether the motion stayed finite.
    """

    values: Mapping[str, Array]
    by: Mapping[str, Array]
    finite: bool


class Simulator:
    """Simulator of a form, for one selection of free parameters and free initial states.

    Parameters
    ----------
    free : names of the parameters with sensitivities, in this order.
    free_states : names of the initial states with sensitivities (``u``, ``psi``, ``x`` ...). Their columns follow those
        of the parameters.
    patience : number of steps per stamp above which a simulation is abandoned as too stiff. Linear models do not need
        it.

    Attributes
    ----------
    states : names of the states, in order: positions, velocities, then lagged inputs if there is a lag.
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
        self._linear = linear_program_of(self.program)
        self.states = states_of(form)
        names = form.parameters
        self._current = tuple(n for n in ("V_x", "V_y") if n in names)
        self._deviation = {n: i for i, n in enumerate(names) if n in COEFFICIENTS}
        self._arm = {n: i for i, n in enumerate(names) if n in LEVER_ARM}
        self._solved: tuple[bytes, tuple[Array, Array]] | None = None
        self._free = np.array([self.free.index(n) if n in self.free else -1 for n in names], dtype=np.int64)
        self._states = np.array(
            [len(self.free) + self.free_states.index(n) if n in self.free_states else -1 for n in self.states],
            dtype=np.int64,
        )
        self._none = np.full_like(self._free, -1)
        self._max_rate = 1.0

    def matrices(self, theta: Array) -> tuple[Array, Array]:
        """Return M (6, 6) and the inverse (k, k) of its active part.

        ``LinAlgError`` is raised if it is singular.
        """
        key = theta.tobytes()
        if self._solved is None or self._solved[0] != key:
            M = inertia_matrix(self.form, theta)
            active = self.program.active
            self._solved = key, (M, np.ascontiguousarray(np.linalg.inv(M[np.ix_(active, active)])))
        return self._solved[1]

    def run(
        self, theta: Array, x_0: Array, t_in: Array, inputs: Array, t_out: Array, *, sensitivities: bool = True
    ) -> tuple[Array, Array] | None:
        """Return the simulated states and their sensitivities, or None if the motion diverges or M is singular.

        Parameters
        ----------
        theta : (p,) parameters in the order of ``form.parameters``.
        x_0 : (n,) state at ``t_out[0]``.
        t_in, inputs : stamps (j,) and values (j, m). Each row applies from its stamp, and the first also before it.
        t_out : (s,) non-decreasing stamps.

        Returns
        -------
        X (s, n) and S (s, n, q); S is (0, 0, 0) without *sensitivities*.

        Raises
        ------
        OutOfTime
            An :class:`.Effort` around the call is used up. Each derivative costs as much work as the motion itself.
        """
        try:
            M, M_inverse = self.matrices(theta)
        except np.linalg.LinAlgError:
            return None
        n, q = len(self.states), len(self.free) + len(self.free_states)
        spend(len(t_out) * (1 + (q if sensitivities else 0)))
        X = np.empty((len(t_out), n))
        S = np.empty((len(t_out), n, q)) if sensitivities else np.empty((0, 0, 0))
        theta, x_0 = np.asarray(theta, dtype=np.float64), np.asarray(x_0, dtype=np.float64)
        t_in, inputs, t_out = (np.ascontiguousarray(each, dtype=np.float64) for each in (t_in, inputs, t_out))
        free = self._free if sensitivities else self._none
        if self._linear is not None:
            inverse = float(M_inverse[0, 0])
            exact = linear_sweep(self._linear, theta, inverse, x_0, t_in, inputs, t_out, free, self._states, X, S)
            return (X, S) if exact else None
        most = STEPS + self.patience * len(t_out)
        beyond = HOPELESS * most * kernel.REACH / max(float(t_out[-1] - t_out[0]), 1e-300) if len(t_out) else math.inf
        tries = TRIES if self.patience >= PATIENCE else 2
        finite, fastest = False, 0.0
        for left in reversed(range(tries)):
            if self._max_rate > beyond:  # nor would shorter steps suffice
                finite = False
                break
            again = self._max_rate if left else math.inf
            finite, fastest = kernel.sweep(
                self.program, theta, M, M_inverse, x_0, t_in, inputs, t_out, free, self._states, self._max_rate, most,
                X, S, again,
            )  # fmt: skip
            if fastest <= self._max_rate:
                break
            self._max_rate = _rate_for(fastest if finite else min(fastest, FINER * self._max_rate))
        enough = finite and fastest <= self._max_rate
        if fastest < SLACK * self._max_rate or not enough:
            self._max_rate = _rate_for(fastest) if enough else 1.0
        return (X, S) if enough else None

    def outputs(self, theta: Array, X: Array, S: Array, signal: str) -> tuple[Array, Array]:
        """Return *signal* (s,) and its sensitivities (s, q) from the result *X*, *S* of :meth:`run`.

        Velocities are over ground: a current is added to those through the water. Velocities and positions are those at
        the sensor, see :mod:`.lever_arm`. With a deviating compass, velocities and heading are as measured with it, see
        :mod:`.compass`.
        """
        deviation = self._deviation
        if not deviation or signal not in ("u", "v", "psi") or "psi" not in self.states:
            return self._at_sensor(theta, X, S, signal)
        still = (np.zeros(len(X)), np.zeros((len(X), S.shape[2] if len(S) else 0)))
        wanted = ("psi",) if signal == "psi" else ("psi", "u", "v")
        true = {n: self._at_sensor(theta, X, S, n) if n in self.states else still for n in wanted}
        columns = {n: self.free.index(n) for n in deviation if n in self.free}
        return seen_by_compass(signal, true, {n: float(theta[i]) for n, i in deviation.items()}, columns)

    def _at_sensor(self, theta: Array, X: Array, S: Array, signal: str) -> tuple[Array, Array]:
        arm = self._arm
        if not arm or signal not in SHOWN_OFF_CENTRE:
            return self._over_ground(theta, X, S, signal)
        wanted = (signal, *(n for n in SHOWN_OFF_CENTRE[signal] if n in self.states))
        x_P, y_P = (float(theta[arm[n]]) if n in arm else 0.0 for n in LEVER_ARM)
        columns = {n: self.free.index(n) for n in arm if n in self.free}
        return seen_off_centre(signal, {n: self._over_ground(theta, X, S, n) for n in wanted}, (x_P, y_P), columns)

    def _over_ground(self, theta: Array, X: Array, S: Array, signal: str) -> tuple[Array, Array]:
        names = self.states
        value, by = X[:, names.index(signal)], S[:, names.index(signal)] if len(S) else np.empty((len(X), 0))
        current = self._current
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
class CoupledModel(Displayed):
    """A model of several degrees of freedom: a form and a value for each of its parameters."""

    form: Form
    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        """Return a parameter's value; 0 for a derivative that the form does not have."""
        return float(self.values.get(name, self.form.known.get(name, 0.0)))

    @property
    def theta(self) -> Array:
        """Values (p,) of the parameters, in the order of ``form.parameters``."""
        return np.array([self[n] for n in self.form.parameters])

    @property
    def inertia(self) -> Array:
        """Inertia matrix M = M_RB + M_A of the active degrees of freedom (k, k)."""
        active = program_of(self.form).active
        M: Array = inertia_matrix(self.form, self.theta)[np.ix_(active, active)]
        return M

    @property
    def linear_damping(self) -> Array:
        """Linear damping matrix D (k, k): minus the linear derivatives, positive for damping."""
        rows = [FORCES.index(DOFS[d].force) for d in self.form.dofs]
        return np.array([[-self[f"{FORCES[i]}_{_NU[j]}"] for j in rows] for i in rows])

    def simulate(
        self, t_in: Array, inputs: Mapping[str, Array], t_out: Array, initial: Mapping[str, float] | None = None
    ) -> CoupledMotion:
        """Return the motion, simulated from *initial* states (default 0) at ``t_out[0]``; see :meth:`Simulator.run`."""
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
        """Return the model as data for a model file."""
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
                "per_inertia": list(form.per_inertia),
            },
            "values": {n: self[n] for n in form.parameters},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> CoupledModel:
        """Return the model that :meth:`to_dict` wrote as *data*. Exceptions are those of :meth:`of_data`."""
        return cls.of_data(conformed(data, CoupledData, "model"))

    @classmethod
    def of_data(cls, contents: CoupledData) -> CoupledModel:
        """Return the model described by the *contents* of a model file.

        Raises
        ------
        BadFile
            A value is missing or has no parameter, or an inertia, a delay or a lag has the wrong sign.
        """
        form = form_of(contents.form, "form")
        missing, strange = set(form.parameters) - set(contents.values), set(contents.values) - set(form.parameters)
        if missing or strange:
            what = "lack" if missing else "are not parameters of the form:"
            raise BadFile(f"values {what} {', '.join(sorted(missing or strange)[:5])}")
        model = cls(form, dict(contents.values))
        model._check_signs()
        return model

    def _check_signs(self) -> None:
        """Reject negative delays and lags, and inertias that are not positive.

        A fit to an input of reversed sign has negative inertia *and* drag. It is accepted, because its motion is the
        same.
        """
        early = [n for n in ("delay", "lag") if self[n] < 0.0]
        if early:
            raise BadFile(f"{early[0]} is {self[early[0]]:g} s, but it must be 0 or more")
        heavy = [n for n in ("m", "I_x", "I_y", "I_z") if n in self.form.parameters and not self[n] > 0.0]
        if heavy:
            raise BadFile(f"{heavy[0]} is {self[heavy[0]]:g}, but it must be above 0")
        try:
            inertia = np.diag(self.inertia)
            np.linalg.inv(self.inertia)
        except np.linalg.LinAlgError as error:
            raise BadFile("its inertia matrix is singular. Every inertia must be above 0") from error
        for dof, value in zip(self.form.dofs, inertia, strict=True):
            force, nu = DOFS[dof].force, DOFS[dof].velocity
            drags = [-self[n] for n in (f"{force}_{nu}", f"{force}_{nu}{nu}", f"{force}_|{nu}|{nu}") if self[n]]
            if not value > 0.0 and not (value < 0.0 and drags and max(drags) < 0.0):
                raise BadFile(f"its inertia in {dof} is {value:g}, but it must be above 0")

    def with_values(self, values: Mapping[str, float]) -> CoupledModel:
        """Return the model with *values* replaced."""
        return replace(self, values={**self.values, **values})


def _rate_for(fastest: float) -> float:
    """Return the lowest rate of the ladder that suffices for a fastest rate [1/s]."""
    return max(1.0, float(PACES[min(int(np.searchsorted(PACES, 1.2 * fastest)), len(PACES) - 1)]))
