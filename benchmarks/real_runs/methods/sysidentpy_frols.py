"""SysIdentPy: NARX polynomials of degree 2 by FROLS, one per output, the other outputs as inputs; free run together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.runs import FIRST, Run

__all__ = ["train"]

LAG = 2


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit on all training runs one after the other (the package takes one record); their seams are a few samples."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    U, Y = np.vstack([r.U for r in runs]), np.vstack([r.Y for r in runs])
    scale_u, scale_y = U.std(axis=0), Y.std(axis=0)
    models = []
    for k in range(3):
        others = [i for i in range(3) if i != k]
        X = np.column_stack([U / scale_u, Y[:, others] / scale_y[others]])
        model = FROLS(
            ylag=LAG,
            xlag=[list(range(1, LAG + 1))] * X.shape[1],
            basis_function=Polynomial(degree=2),
            estimator=LeastSquares(),
            info_criteria="bic",
            n_info_values=20,
        )
        model.fit(X=X, y=(Y[:, [k]] / scale_y[k]))
        models.append(_terms(model))

    def predict(run: Run) -> tuple[NDArray[np.float64], None]:
        U_s, Y_s = run.U / scale_u, run.Y / scale_y
        out = np.full_like(Y_s, np.nan)
        out[:FIRST] = Y_s[:FIRST]
        for i in range(FIRST, len(out)):
            for k, terms in enumerate(models):
                others = [j for j in range(3) if j != k]
                channels = [out[:, k], *U_s.T, *(out[:, j] for j in others)]
                out[i, k] = sum(c * np.prod([channels[a][i - lag] for a, lag in f]) for c, f in terms)
            if not np.all(np.abs(out[i]) < 1e3):
                break
        return out * scale_y, None

    return predict


def _terms(model: object) -> list[tuple[float, list[tuple[int, int]]]]:
    """Return (coefficient, [(channel, lag), ...]) of every term; channel 0 is the output, then the inputs.

    The package codes regressors as 1000*(channel + 1) + lag, 0 for the constant factor.
    """
    codes, theta = model.final_model, model.theta.ravel()  # type: ignore[attr-defined]
    return [
        (float(c), [(int(code) // 1000 - 1, int(code) % 1000) for code in row if code])
        for c, row in zip(theta, codes, strict=True)
    ]
