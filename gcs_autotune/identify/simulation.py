"""Simulate an identified model from its inputs alone, without measurements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.effects import ExtendedModel, ExtendedSimulator, passage_of
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.axis.form import as_extended
from gcs_autotune.identify.result import Fit, Model
from gcs_autotune.models import CoupledModel, SingleDof
from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["extended_of", "simulated"]

Array = NDArray[np.float64]

STEP = 0.1
"""Time [s] between the stamps of a simulation, if the caller supplies no stamps. Project choice."""


def extended_of(fit: Fit[Model]) -> ExtendedModel:
    """Return the model of *fit* as an extended model (a model with effects), even if it has no effects.

    Raises
    ------
    UsageError
        This kind of model cannot be simulated.
    """
    model = fit.whole_model
    if isinstance(model, SingleDof):
        model = as_extended(model)
    elif isinstance(model, CoupledModel):
        model = ExtendedModel(model)
    if not isinstance(model, ExtendedModel):
        raise UsageError(f"a {type(model).__name__} (method {fit.method}) cannot be simulated. Use output-error")
    return model


def simulated(
    fit: Fit[Model],
    inputs: Trial | Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    stamps: ArrayLike | None = None,
    start: Mapping[str, float] | None = None,
) -> Trial:
    """Return the motion that the model of *fit* predicts for *inputs*, together with the inputs.

    Parameters
    ----------
    inputs : a run whose input channels are used; or name of the input -> (stamps [s] (j,), values (j,)). The values are
        in the units of the identification and are held until the next stamp.
    stamps : (n,) ascending times [s] of the motion. None takes ten per second from the first input to the last.
    start : name of the state -> value (SI, radians) at the first stamp. The default is the first sample of a run,
        otherwise 0.

    Raises
    ------
    MissingChannel, UsageError
        An input of the model is missing or in another unit.
    NotInformative
        The simulation diverges.

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
        raise UsageError(f"the model has no state {', '.join(strange)}. Its states are {', '.join(states)}")
    predicted = model.predict(
        passage_of("simulated", t_in, commands, dict.fromkeys(states, at)), {**first, **(start or {})}
    )
    if predicted is None:
        raise NotInformative("the model diverges on these inputs. Simulate a shorter part, or a smaller input")
    motion = {n: Channel(n, SIGNALS[n][0], at, y) for n, y in predicted.items()}
    return Trial("simulated", {**given, **motion}, meta={"source": "simulated"})


def _unit(fit: Fit[Model], model: ExtendedModel, name: str) -> str:
    """Return the unit of an input in the fit, or an empty text if it is unknown."""
    if isinstance(fit.model, SingleDof):
        return fit.model.input_unit
    return str(model.units.get(name) or (fit.extra.get("inputs") or {}).get(name, ""))


def _channel(inputs: Trial | Mapping[str, tuple[ArrayLike, ArrayLike]], name: str, unit: str) -> Channel:
    """Return one input of the model, in the model's unit."""
    if isinstance(inputs, Trial):
        channel = inputs[name]
        if unit and channel.unit != unit:
            raise UsageError(
                f"{name} of run '{inputs.name}' is in {channel.unit}, but the model needs {unit}. Convert the column"
            )
        return channel
    if name not in inputs:
        raise UsageError(
            f"the model needs the input {name}. Supply its time stamps and values. Supplied so far: {', '.join(inputs)}"
        )
    t, values = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in inputs[name])
    if t.shape != values.shape or len(t) == 0 or np.any(np.diff(t) < 0.0):
        raise UsageError(
            f"the time stamps and values of {name} do not match. Supply at least one value and one time stamp "
            "per value, in ascending order"
        )
    return Channel(name, unit, t, values)


def _held(channel: Channel, t: Array) -> Array:
    """Return the value in force at each of *t*.

    Before the first stamp it is the first value.
    """
    held: Array = channel.values[np.maximum(np.searchsorted(channel.t, t, side="right") - 1, 0)]
    return held
