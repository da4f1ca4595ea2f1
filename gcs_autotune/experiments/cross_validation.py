"""Scores of a structure from free runs: likelihood, information criteria, held-out errors.

Several runs are split by run, a single one by time. The criteria are calculated from free-run residuals for every
method, with one noise level per signal at its most likely value. Coloured residuals would make every extra parameter
look certain. The likelihood is therefore divided by the correlation time of the residuals, which is common to all
models compared, as for single axes (:mod:`gcs_autotune.identify.axis.evidence`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify import Fit, Model, Trace, validate
from gcs_autotune.identify.signals import correlation_time
from gcs_autotune.trial import Channel, Trial

__all__ = [
    "BLOCKS",
    "MOST_FOLDS",
    "Fold",
    "amplitudes_of",
    "correlation_of",
    "cross_validated",
    "folds_of",
    "log_likelihood_of",
    "rms_per_signal",
]

BLOCKS = 4
"""Number of blocks into which a single run is divided.

Project choice: three quarters of the run remain for each fit.
"""

MOST_FOLDS = 6
"""Maximum number of folds. Project choice. With more runs, several runs are left out together."""


@dataclass(frozen=True, slots=True)
class Fold:
    """One fold of a cross-validation: the model is fitted to ``train`` and predicts ``held``."""

    train: tuple[Trial, ...]
    held: tuple[Trial, ...]


def folds_of(trials: Sequence[Trial], inputs: Sequence[str]) -> tuple[Fold, ...]:
    """Return the folds of *trials*.

    inputs : input channels, whose last value before a cut in time still applies after the cut.
    """
    if len(trials) == 1:
        return _in_time(trials[0], frozenset(inputs))
    groups = np.array_split(np.arange(len(trials)), min(len(trials), MOST_FOLDS))
    return tuple(
        Fold(tuple(t for i, t in enumerate(trials) if i not in g), tuple(trials[i] for i in g)) for g in groups
    )


def _in_time(trial: Trial, inputs: frozenset[str]) -> tuple[Fold, ...]:
    edges = np.linspace(trial.start, trial.end, BLOCKS + 1)
    edges[-1] = np.nextafter(edges[-1], np.inf)
    parts = [_part(trial, float(a), float(b), k, inputs) for k, (a, b) in enumerate(itertools.pairwise(edges))]
    return tuple(Fold(tuple(p for p in parts if p is not held), (held,)) for held in parts)


def _part(trial: Trial, start: float, end: float, k: int, inputs: frozenset[str]) -> Trial:
    """Return the part with ``start <= t < end``, with the inputs at its start."""
    channels = {}
    for name, channel in trial.channels.items():
        keep = (channel.t >= start) & (channel.t < end)
        t, values = channel.t[keep], channel.values[keep]
        if name in inputs and len(channel) and not (len(t) and t[0] == start):
            t, values = np.concatenate([[start], t]), np.concatenate([[channel.held_at(start)], values])
        channels[name] = Channel(name, channel.unit, t, values)
    return replace(trial, name=f"{trial.name}/{k + 1}", channels=channels, marks=(), meta={})


Fitter = Callable[[Sequence[Trial]], Fit[Model]]


def log_likelihood_of(traces: Sequence[Trace]) -> float:
    """Return the log-likelihood of the residuals of *traces* as white noise, with the most likely noise level for
    each signal.
    """
    total = 0.0
    for errors in _by_signal(traces).values():
        rms = math.sqrt(float(np.mean(np.square(errors))))
        total -= len(errors) * (math.log(max(rms, 1e-300)) + 0.5 * math.log(2.0 * math.pi) + 0.5)
    return total


def correlation_of(traces: Sequence[Trace]) -> float:
    """Return the number of samples that are equivalent to one independent sample. It is 1 for white residuals."""
    errors = [t.measured - t.fitted for t in traces if len(t.t) >= 20]
    return correlation_time(errors) if errors else 1.0


def rms_per_signal(traces: Sequence[Trace]) -> dict[str, float]:
    """Return name of the signal -> root mean square of measured minus simulated values, SI units."""
    return {n: math.sqrt(float(np.mean(np.square(e)))) for n, e in _by_signal(traces).items()}


def amplitudes_of(traces: Sequence[Trace]) -> dict[str, float]:
    """Return name of the signal -> standard deviation of the measured values, with which its error is compared."""
    names = dict.fromkeys(t.signal for t in traces)
    return {n: float(np.std(np.concatenate([t.measured for t in traces if t.signal == n]))) for n in names}


def cross_validated(
    fitter: Fitter, folds: Sequence[Fold], amplitudes: Mapping[str, float]
) -> tuple[list[float], dict[str, float]]:
    """Return the error of each fold relative to *amplitudes*, and the rms error per signal over all folds.

    fitter : function that fits a model to runs.
    amplitudes : name of the signal -> amplitude (:func:`amplitudes_of`).

    The error of a fold is infinite if its training data cannot be fitted or the fit diverges on the held-out data.
    Folds without information are skipped.
    """
    errors, traces = [], []
    for fold in folds:
        try:
            found = validate(fitter(fold.train).model, fold.held).traces
        except (MissingChannel, BadFile):
            continue
        except NotInformative:
            errors.append(math.inf)
            continue
        traces += list(found)
        shares = [rms / max(amplitudes[n], 1e-300) for n, rms in rms_per_signal(found).items() if n in amplitudes]
        errors.append(float(np.mean(shares)))
    return errors, rms_per_signal(traces)


def _by_signal(traces: Sequence[Trace]) -> dict[str, np.ndarray]:
    names = dict.fromkeys(t.signal for t in traces)
    return {n: np.concatenate([t.measured - t.fitted for t in traces if t.signal == n]) for n in names}
