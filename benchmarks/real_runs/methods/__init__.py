"""The methods compared, one file each: a function ``train(runs, form name) -> predict``.

``predict(run) -> (Y, psi or None)``: motion (n, 3) from the inputs and the first ``FIRST`` samples. A file imports
its package only when it is called, so that no peer is needed by the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.runs import Run

__all__ = ["Predict", "Train"]

Array = NDArray[np.float64]
Predict = Callable[[Run], tuple[Array, Array | None]]
Train = Callable[[Sequence[Run], str], Predict]
