"""sippy_unipi: N4SID of order 4 on the training runs joined (the package takes one record)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.methods.linear_state_space import free_run
from benchmarks.real_runs.runs import STEP, Run

__all__ = ["train"]

ORDER = 4


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit."""
    from sippy_unipi import system_identification

    U, Y = np.vstack([r.U for r in runs]), np.vstack([r.Y for r in runs])
    scale_u, scale_y = U.std(axis=0), Y.std(axis=0)
    model = system_identification(
        (Y / scale_y).T, (U / scale_u).T, "N4SID", tsample=STEP, SS_fixed_order=ORDER, SS_f=15, SS_p=15
    )
    A, B, C, D = (np.asarray(getattr(model, n)) for n in "ABCD")
    return lambda run: free_run(A, B, C, D, run, scale_u, scale_y)
