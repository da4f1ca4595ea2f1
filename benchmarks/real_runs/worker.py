"""Run one method on one craft in its own process: ``python -m benchmarks.real_runs.worker CRAFT METHOD``.

Writes one line of JSON: CPU seconds and memory of the training, fit percent per held-out run and signal.
"""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sys
import time
import warnings

from benchmarks.real_runs.methods.table import trainer
from benchmarks.real_runs.runs import CRAFTS, gridded, load
from benchmarks.real_runs.score import fit_percents

__all__ = ["main"]


def main() -> None:
    """Train, predict, score."""
    craft, method = CRAFTS[sys.argv[1]], sys.argv[2]
    training = [gridded(load(craft, n), craft.inputs) for n in craft.train]
    train = trainer(method)
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        before, begun = _peak(), time.process_time()
        predict = train(training, craft.form)
        seconds, memory = time.process_time() - begun, _peak() - before
        scores = {}
        for name in craft.held:
            run = gridded(load(craft, name), craft.inputs)
            scores[name] = fit_percents(run, *predict(run))
    print(json.dumps({"seconds": seconds, "memory": memory, "scores": scores}))


def _peak() -> float:
    """Return this process's peak memory [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


if __name__ == "__main__":
    main()
