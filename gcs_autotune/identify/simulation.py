"""What an identified model makes of inputs, on its own: no measurement is asked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.effects import ExtendedModel, ExtendedSimulator, passage_of
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.identify.result import Fit, Model, whole_model
from gcs_autotune.models import CoupledModel, SingleDof
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["extended_of", "simulated"]

Array = NDArray[np.float64]

STEP = 0.1
"""Seconds between stamps where none are given."""


def extended_of(fit: Fit[Model]) -> ExtendedModel:
    """Return the model of *fit* as one with effects (perhaps none).

    Raises
    ------
    UsageError
        It is of a kind that cannot be simulated.
    """
    model = whole_model(fit)
    if isinstance(model, SingleDof):
        model = as_extended(model)
    elif isinstance(model, CoupledModel):
        model = ExtendedModel(model)
    if not isinstance(model, ExtendedModel):
        raise UsageError(f"a {type(model).__name__} (method {fit.method}) cannot be simulated; use output-error")
    return model


def simulated(
    fit: Fit[Model],
    inputs: Trial | Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    stamps: ArrayLike | None = None,
    start: Mapping[str, float] | None = None,
) -> Trial:
    """Return the motion that the model of *fit* predicts for *inputs*, with the inputs beside it.

    Parameters
    ----------
    inputs : a run, of which the input channels are used; or input -> (stamps [s] (j,), values (j,)) in the units the
        model was identified in, each held from its stamp to the next.
    stamps : (n,) where the motion is required [s], ascending; ten a second from the first input to the last when None.
    start : state -> value (SI, radians) at the first stamp; 0 for those not named, and of a run its first samples.

    Raises
    ------
    MissingChannel, UsageError
        An input of the model is not there, or in another unit. NotInformative: the simulation diverges.

    Examples
    --------
    >>> from gcs_autotune.api import example_run, fit, simulate
    >>> found = fit(example_run(), "linear", dof="yaw", delay=0.0)
    >>> motion = simulate(found, {"N": ([0.0, 10.0], [0.1, 0.1])}, start={"psi": 0.5})
    >>> sorted(motion.channels), motion["r"].unit, float(motion["psi"].values[0])
    (['N', 'psi', 'r'], 'rad/s', 0.5)
    """
    model = extended_of(fit)
    form = model.base.form
    names = tuple(form.inputs)
    given = {n: _channel(inputs, n, _unit(fit, model, n)) for n in names if n in inputs or n not in form.optional}
    t_in = np.unique(np.concatenate([c.t for c in given.values()]))
    commands = {n: _held(given[n], t_in) if n in given else np.zeros(len(t_in)) for n in names}
    at = np.arange(t_in[0], t_in[-1] + 0.5 * STEP, STEP) if stamps is None else np.asarray(stamps, dtype=np.float64)
    states = [n for n in ExtendedSimulator(form, model.effects).states if n in SIGNALS]
    first = {n: float(inputs[n].values[0]) for n in states if n in inputs} if isinstance(inputs, Trial) else {}
    strange = sorted(set(start or {}) - set(states))
    if strange:
        raise UsageError(f"the model has no state {', '.join(strange)}; it has {', '.join(states)}")
    found = model.predict(
        passage_of("simulated", t_in, commands, dict.fromkeys(states, at)), {**first, **(start or {})}
    )
    if found is None:
        raise NotInformative("the model diverges on these inputs: simulate a shorter part, or a smaller input")
    motion = {n: Channel(n, SIGNALS[n][0], at, y) for n, y in found.items()}
    return Trial("simulated", {**given, **motion}, meta={"source": "simulated"})


def _unit(fit: Fit[Model], model: ExtendedModel, name: str) -> str:
    """Return the unit of an input as the fit knew it; empty when nobody said."""
    if isinstance(fit.model, SingleDof):
        return fit.model.input_unit
    return str(model.units.get(name) or (fit.extra.get("inputs") or {}).get(name, ""))


def _channel(inputs: Trial | Mapping[str, tuple[ArrayLike, ArrayLike]], name: str, unit: str) -> Channel:
    """Return one input, in the model's unit."""
    if isinstance(inputs, Trial):
        channel = inputs[name]
        if unit and channel.unit != unit:
            raise UsageError(f"{name} of run '{inputs.name}' is in {channel.unit}, the model's is in {unit}")
        return channel
    if name not in inputs:
        raise UsageError(f"the model is driven by {name}: give its stamps and values; given are {', '.join(inputs)}")
    t, values = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in inputs[name])
    if t.shape != values.shape or len(t) == 0 or np.any(np.diff(t) < 0.0):
        raise UsageError(f"{name}: as many ascending stamps as values are needed, and at least one")
    return Channel(name, unit, t, values)


def _held(channel: Channel, t: Array) -> Array:
    """Return the value in force at each of *t* (the first one before the first stamp)."""
    held: Array = channel.values[np.maximum(np.searchsorted(channel.t, t, side="right") - 1, 0)]
    return held
