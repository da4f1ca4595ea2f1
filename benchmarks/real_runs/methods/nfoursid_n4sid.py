"""nfoursid: N4SID of order 4 on the training runs joined (the package takes one record)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.methods.linear_state_space import free_run
from benchmarks.real_runs.runs import Run

__all__ = ["train"]

ORDER = 4


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit."""
    import pandas
    from nfoursid.nfoursid import NFourSID

    U, Y = np.vstack([r.U for r in runs]), np.vstack([r.Y for r in runs])
    scale_u, scale_y = U.std(axis=0), Y.std(axis=0)
    ins, outs = [f"u{i}" for i in range(U.shape[1])], [f"y{i}" for i in range(3)]
    frame = pandas.DataFrame(np.column_stack([U / scale_u, Y / scale_y]), columns=[*ins, *outs])
    found = NFourSID(frame, output_columns=outs, input_columns=ins, num_block_rows=10)
    found.subspace_identification()
    model, _ = found.system_identification(rank=ORDER)
    return lambda run: free_run(model.a, model.b, model.c, model.d, run, scale_u, scale_y)
