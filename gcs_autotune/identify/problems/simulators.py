"""Simulate the signals of a segment for a likelihood, with derivatives by all parameters that may be fitted.

There are three kernels: one degree of freedom (exact), coupled forms, and forms with effects. A likelihood uses each
kernel as a form (names of parameters and states) and a :class:`SegmentSimulator`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, STEP, DataSummary, EffectInstance, ExtendedSimulator, horizon
from gcs_autotune.identify.axis.form import ExplicitForm
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import (
    COS_PSI,
    ETA,
    NEAR,
    SIN_PHI,
    SIN_PSI,
    SIN_THETA,
    Form,
    Simulator,
    program_of,
    simulate_explicit,
)
from gcs_autotune.sname import DOFS

__all__ = ["Predicted", "SegmentSimulator", "free_states", "simulator_of", "typical_of"]

Array = NDArray[np.float64]
Predicted = dict[str, tuple[Array, Array]]

PATIENCE = 30
"""Maximum number of integration steps per stamp for models without effects.

Project choice. Models that need more are too stiff for the sampling.
"""

_POSITIONS = ("x", "y", "z", "phi", "theta", "psi")


class SegmentSimulator(Protocol):
    """Interface of a simulator for one form, with or without effects, and one selection of free parameters."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in the order of the state vector."""

    @property
    def free_states(self) -> tuple[str, ...]:
        """Names of the initial states whose derivatives are calculated."""

    def predict(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        segment: Segment,
        shift: float,
        *,
        sensitivities: bool,
    ) -> Predicted | None:
        """Return name of the signal -> values at its stamps (n,) and their Jacobian, or None if the motion diverges.

        The columns of the Jacobian are the free base parameters, the free parameters of effects, and the free initial
        states. The shift [s] of the inputs relative to their stamps comes last, if it is fitted.
        """


class AxisSimulator:
    """Simulator of one degree of freedom with the exact kernel.

    A shift of the input stamps is added to the delay.
    """

    def __init__(self, form: ExplicitForm, free: Sequence[str], free_states: Sequence[str], *, dated: bool) -> None:
        dof = DOFS[form.dofs[0]]
        self.states = (dof.position, dof.velocity)
        self.free_states = tuple(free_states)
        names = (*form.parameters, *self.states)
        self._delay = names.index("delay")
        self._columns = [*(names.index(n) for n in (*free, *free_states)), *([self._delay] if dated else [])]
        self._position = dof.position

    def predict(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        segment: Segment,
        shift: float,
        *,
        sensitivities: bool,
    ) -> Predicted | None:
        """Return name of the signal -> values and their Jacobian; see :class:`SegmentSimulator`.

        The Jacobian is always calculated.
        """
        numbers = np.concatenate([theta, x_0])
        if segment.dating:
            numbers[self._delay] += shift
        motion = simulate_explicit(numbers, segment.t_in, segment.tau, segment.stamps)
        if not motion.finite:
            return None
        prediction = {}
        for name, at in segment.at.items():
            position = name == self._position
            value, by = (motion.eta, motion.eta_by) if position else (motion.nu, motion.nu_by)
            prediction[name] = (value[at], by[at][:, self._columns])
        return prediction


class FormSimulator:
    """Simulator of a coupled form without effects.

    The derivative by the shift of the stamps equals that by a delay.
    """

    def __init__(
        self, form: Form, free: Sequence[str], free_states: Sequence[str], *, dated: bool, patience: int | None
    ) -> None:
        self.free_states = tuple(free_states)
        self._dated, self._count = dated, len(free)
        whole = form.freeing("delay") if dated and "delay" not in form.parameters else form
        self._places = [whole.parameters.index(n) for n in form.parameters]
        self._size = len(whole.parameters)
        wanted = (*free, "delay") if dated else tuple(free)
        self._simulator = Simulator(
            whole, wanted, self.free_states, patience=PATIENCE if patience is None else patience
        )

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in the order of the state vector."""
        return self._simulator.states

    def predict(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        segment: Segment,
        shift: float,
        *,
        sensitivities: bool,
    ) -> Predicted | None:
        """Return name of the signal -> values (n,) at its stamps and their Jacobian; see :class:`SegmentSimulator`."""
        values = np.zeros(self._size)
        values[self._places] = theta
        t_in = segment.t_in + shift if shift and segment.dating else segment.t_in
        motion = self._simulator.run(values, x_0, t_in, segment.inputs, segment.stamps, sensitivities=sensitivities)
        if motion is None:
            return None
        predicted = {}
        for name, at in segment.at.items():
            value, by = self._simulator.outputs(values, *motion, name)
            by = by[at]
            if self._dated and sensitivities:
                late = by[:, self._count : self._count + 1] * float(segment.dating > 0.0)
                by = np.hstack([by[:, : self._count], by[:, self._count + 1 :], late])
            predicted[name] = (value[at], by)
        return predicted


class EffectSimulator:
    """Simulator of a coupled form with effects.

    The derivative by the shift of the stamps is a finite difference. Its length equals that used for ``input-delay``,
    so that both derivatives are consistent.
    """

    def __init__(self, simulator: ExtendedSimulator, data_summary: DataSummary, *, dated: bool) -> None:
        self._simulator, self._dated, self._step = simulator, dated, STEP * horizon(data_summary)[1]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in the order of the state vector."""
        return self._simulator.states

    @property
    def free_states(self) -> tuple[str, ...]:
        """Names of the initial states whose derivatives are calculated."""
        return self._simulator.free_states

    def predict(
        self,
        theta: Array,
        effects: Sequence[EffectInstance],
        x_0: Array,
        segment: Segment,
        shift: float,
        *,
        sensitivities: bool,
    ) -> Predicted | None:
        """Return name of the signal -> values (n,) at its stamps and their Jacobian; see :class:`SegmentSimulator`."""
        prediction = self._simulator.run(theta, effects, x_0, segment.passage_at(shift), sensitivities=sensitivities)
        if prediction is None or not (sensitivities and self._dated):
            return prediction
        later = self._simulator.run(theta, effects, x_0, segment.passage_at(shift + self._step))
        if later is None:
            return None
        return {n: (y, np.column_stack([by, (later[n][0] - y) / self._step])) for n, (y, by) in prediction.items()}


def simulator_of(
    form: Form,
    effects: Sequence[EffectInstance],
    free: Sequence[str],
    free_effects: Sequence[tuple[int, str]],
    states: Sequence[str],
    *,
    typical: Sequence[float],
    data_summary: DataSummary | None,
    dated: bool,
    patience: int | None,
) -> SegmentSimulator:
    """Return the simulator for *form* with *effects*.

    With a *data_summary* the simulator supports effects, even if *effects* is empty.
    """
    if isinstance(form, ExplicitForm):
        return AxisSimulator(form, free, states, dated=dated)
    if data_summary is None:
        return FormSimulator(form, free, states, dated=dated, patience=patience)
    return EffectSimulator(
        ExtendedSimulator(form, effects, free, free_effects, states, typical), data_summary, dated=dated
    )


def free_states(form: Form, effects: Sequence[EffectInstance], segment: Segment) -> tuple[str, ...]:
    """Return the names of the initial states to fit, which are all states that a measured signal of *segment* depends
    on.
    """
    if isinstance(form, ExplicitForm):
        dof = DOFS[form.dofs[0]]
        return (dof.position, dof.velocity) if dof.position in segment.signals else (dof.velocity,)
    form = ExtendedSimulator(form, effects).form if effects else form
    measured = set(segment.signals)
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


def typical_of(own: EffectInstance, data_summary: DataSummary) -> dict[str, float]:
    """Return name -> typical size of each parameter of the effect *own*.

    It is the largest magnitude of its start values and its present value.
    """
    entry = EFFECTS[own.slug]
    starts = entry.starts(own.place, data_summary)
    sizes = {}
    for name in own.values:
        largest = max((abs(s.get(name, 0.0)) for s in starts), default=0.0)
        sizes[name] = max(largest, abs(own.values[name])) or 1.0
    return sizes
