"""A fit on its runs, seen as a coupled model whatever its kind: what every question of this room starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.axis.record import MIN_SAMPLES, prepare
from gcs_autotune.identify.coupled.objective import CoupledObjective, Limits
from gcs_autotune.identify.coupled.one_axis import SIGNS, axis_form, derivative_names
from gcs_autotune.identify.coupled.output_error import solve_coupled
from gcs_autotune.identify.coupled.record import CoupledRecord, prepare_coupled, signals_of
from gcs_autotune.identify.coupled.start import ground_of
from gcs_autotune.identify.result import AxisFit, Fit
from gcs_autotune.models import SingleDof
from gcs_autotune.models.coupled import CoupledModel, Form, Simulator
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Trial

__all__ = ["Subject", "subject_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A model on runs.

    ``theta`` (q,) in the order of ``form.parameters``; ``free`` the form's names of what was fitted, ``names`` what the
    fit calls them (``alpha_r`` for ``N_rdot``), ``signs`` (p,) with ``named value = sign * form's value``; ``initial``
    (n,) fitted states per record; ``noise`` standard deviation per signal, SI units.
    """

    form: Form
    theta: Array
    free: tuple[str, ...]
    names: tuple[str, ...]
    signs: Array
    units: tuple[str, ...]
    records: tuple[CoupledRecord, ...]
    initial: tuple[Array, ...]
    noise: Mapping[str, float]

    @property
    def places(self) -> NDArray[np.int64]:
        """Where ``free`` stands in ``theta`` (p,)."""
        return np.array([self.form.parameters.index(n) for n in self.free], dtype=np.int64)

    @property
    def values(self) -> Array:
        """Values (p,) under the fit's names."""
        return self.signs * self.theta[self.places]

    def objective(self, free: Sequence[str] | None = None) -> CoupledObjective:
        """Return the output-error cost of *free* (form's names; all fitted ones when None) and the initial states."""
        names = self.free if free is None else tuple(free)
        return CoupledObjective(self.form, self.records, names, self.theta, self.initial)

    def motion(self, record: int) -> tuple[Array, Array]:
        """Return stamps (s,) and simulated states (s, n) of one record.

        Raises
        ------
        NotInformative
            The model runs away.
        """
        own = self.records[record]
        stamps = own.stamps
        found = Simulator(self.form).run(
            self.theta, self.initial[record], own.t_in, own.inputs, stamps, sensitivities=True
        )
        if found is None:
            raise NotInformative(f"the model '{self.form.name}' runs away on run '{own.run}'")
        return stamps, found[0]


def subject_of(fit: Fit, trials: Trial | Sequence[Trial]) -> Subject:
    """Return *fit* on *trials*, its initial states fitted to them.

    Noise is what the fit found, and where it says nothing the rms of what the free run leaves.

    Raises
    ------
    UsageError
        The fit's model is of a kind that cannot be simulated, or nothing in it was fitted.
    NotInformative
        The model runs away on a run; and as :func:`prepare_coupled`.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    model = fit.model
    if isinstance(model, CoupledModel):
        form, theta = model.form, model.theta
        free = tuple(n for n in form.parameters if n in fit.parameters and fit.parameters[n].status == "fitted")
        names, signs = free, np.ones(len(free))
    elif isinstance(model, SingleDof) and isinstance(fit, AxisFit):
        form, theta, free, names, signs = _of_axis(fit, model, runs)
    else:
        raise UsageError(
            f"what runs can tell of a {type(model).__name__} is not worked out here; diagnose says what to fly next"
        )
    if not free:
        raise UsageError(f"nothing of '{fit.structure}' was fitted: there is no limit to tell")
    records = tuple(r for run in runs for r in prepare_coupled(run, form, _signals(fit, form, run)))
    ground = ground_of(form, records, model_delay(form, theta))
    found = solve_coupled(form, records, theta, ground.initial, Limits({}, {}), levels=ground.levels, free=())
    if found is None:
        raise NotInformative(f"the model '{form.name}' runs away on run '{records[0].run}': its drag destabilises it")
    noise = {n: fit.noise[n] if fit.noise.get(n, 0.0) > 0.0 else level for n, level in found.noise.items()}
    units = tuple(fit.parameters[n].unit for n in names)
    return Subject(form, theta, free, names, signs, units, records, found.initial, noise)


def model_delay(form: Form, theta: Array) -> float:
    """Return the delay [s] of a model, 0 when it has none."""
    return float(theta[form.parameters.index("delay")]) if "delay" in form.parameters else 0.0


def _of_axis(
    fit: AxisFit, model: SingleDof, runs: Sequence[Trial]
) -> tuple[Form, Array, tuple[str, ...], tuple[str, ...], Array]:
    dof = DOFS[model.dof]
    labels, derivatives = tuple(fit.parameters), derivative_names(dof)
    fitted = [fit.parameters[n].status == "fitted" for n in labels]
    delay = None if fitted[4] else model.delay
    input_name = prepare(runs[0], dof)[0].input_name
    form = axis_form(dof, input_name, fit.structure, normalised=model.input_unit == "1", delay=delay)
    numbers = (model.alpha, model.beta, model.beta_quadratic, model.delta, model.delay)
    values = {n: s * v for n, s, v in zip(derivatives, SIGNS, numbers, strict=True)}
    theta = np.array([values[n] for n in form.parameters])
    at = [i for i, n in enumerate(derivatives) if fitted[i] and n in form.free]
    free = tuple(derivatives[i] for i in at)
    return form, theta, free, tuple(labels[i] for i in at), np.array([SIGNS[i] for i in at])


def _signals(fit: Fit, form: Form, run: Trial) -> tuple[str, ...] | None:
    """Return the signals the fit was made from, None when it does not say."""
    there = tuple(n for n in signals_of(form) if n in fit.noise and n in run and len(run[n]) >= MIN_SAMPLES)
    return there or None
