"""What a free run says for a structure: likelihood, information criteria, errors on data left out.

The criteria are computed from free-run residuals, whichever method made the fit, one noise level per signal at its most
likely value. Coloured residuals would make every extra parameter look certain; the likelihood is therefore tempered by
their correlation time, common to all rivals, as on single axes (:mod:`gcs_autotune.identify.axis.evidence`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.identify.colour import correlation_time
from gcs_autotune.identify.limits.folds import Fold
from gcs_autotune.identify.result import Fit, Trace
from gcs_autotune.identify.validate import validate
from gcs_autotune.trial import Trial

__all__ = ["correlation_of", "cross_validated", "log_likelihood_of", "rms_per_signal", "swings_of"]

Fitter = Callable[[Sequence[Trial]], Fit]


def log_likelihood_of(traces: Sequence[Trace]) -> float:
    """Return the log-likelihood of white noise, its level per signal the most likely one."""
    total = 0.0
    for errors in _by_signal(traces).values():
        rms = math.sqrt(float(np.mean(np.square(errors))))
        total -= len(errors) * (math.log(max(rms, 1e-300)) + 0.5 * math.log(2.0 * math.pi) + 0.5)
    return total


def correlation_of(traces: Sequence[Trace]) -> float:
    """Return how many samples make one independent one, 1 when no signal is coloured."""
    errors = [t.measured - t.fitted for t in traces if len(t.t) >= 20]
    return correlation_time(errors) if errors else 1.0


def rms_per_signal(traces: Sequence[Trace]) -> dict[str, float]:
    """Return the root mean square of measured minus simulated, SI units."""
    return {n: math.sqrt(float(np.mean(np.square(e)))) for n, e in _by_signal(traces).items()}


def swings_of(traces: Sequence[Trace]) -> dict[str, float]:
    """Return the standard deviation of each measured signal, what an error is compared with."""
    names = dict.fromkeys(t.signal for t in traces)
    return {n: float(np.std(np.concatenate([t.measured for t in traces if t.signal == n]))) for n in names}


def cross_validated(
    fitter: Fitter, folds: Sequence[Fold], swings: Mapping[str, float]
) -> tuple[list[float], dict[str, float]]:
    """Return the error per fold, in shares of the signals' swings, and the rms per signal over all folds.

    A fold whose training part cannot be fitted, or whose fit runs away on what was left out, counts as infinite: a
    structure that needs all the data to stand up does not generalise. Folds nothing can be read from are passed over.
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
        shares = [rms / max(swings[n], 1e-300) for n, rms in rms_per_signal(found).items() if n in swings]
        errors.append(float(np.mean(shares)))
    return errors, rms_per_signal(traces)


def _by_signal(traces: Sequence[Trace]) -> dict[str, np.ndarray]:
    names = dict.fromkeys(t.signal for t in traces)
    return {n: np.concatenate([t.measured - t.fitted for t in traces if t.signal == n]) for n in names}
