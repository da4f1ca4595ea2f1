"""PySINDy: sparse regression of u, v, r on a library of degree 2, smoothed differences, several runs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.runs import FIRST, STEP, Run

__all__ = ["train"]


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit with signals scaled to unit deviation, threshold 0.02 of that per second."""
    import pysindy

    scale_u, scale_y = np.vstack([r.U for r in runs]).std(axis=0), np.vstack([r.Y for r in runs]).std(axis=0)
    model = pysindy.SINDy(
        feature_library=pysindy.PolynomialLibrary(degree=2),
        optimizer=pysindy.STLSQ(threshold=0.02, alpha=1e-3),
        differentiation_method=pysindy.SmoothedFiniteDifference(),
    )
    model.fit([r.Y / scale_y for r in runs], t=STEP, u=[r.U / scale_u for r in runs])

    def predict(run: Run) -> tuple[NDArray[np.float64], None]:
        out = np.full_like(run.Y, np.nan)
        out[:FIRST] = run.Y[:FIRST]
        x = run.Y[FIRST - 1] / scale_y

        def slope(x: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(model.predict(x[None, :], u=u[None, :]))[0]

        for i in range(FIRST, len(out)):
            u = run.U[i - 1] / scale_u
            k1 = slope(x, u)
            k2 = slope(x + STEP * k1, u)
            x = x + 0.5 * STEP * (k1 + k2)
            if not np.all(np.abs(x) < 1e3):
                break
            out[i] = x * scale_y
        return out, None

    return predict
