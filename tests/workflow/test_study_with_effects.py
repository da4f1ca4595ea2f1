"""A study of a model with effects: the check on data left out keeps the effects' own clock and memory."""

from __future__ import annotations

import numpy as np

from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import StudySettings, study
from sitl.effects.table import make_effect
from sitl.open_loop import Hull, open_loop


def drifting(seed: int) -> Trial:
    """Return a yaw run whose thrust sags by half."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 80.0, 2.5)
    steps = [(float(a), float(b)) for a, b in zip(t, rng.uniform(-1.0, 1.0, len(t)), strict=True)]
    table = open_loop(
        Hull(("yaw",), {"yaw": 2.0}, {"yaw": 1.5}),
        {"N": steps},
        duration=80.0,
        interval=0.1,
        measured=("psi", "r"),
        effects=[make_effect("gain-drift", "N", {"rate": 0.006})],
        noise={"psi": 0.01, "r": 0.01},
        seed=seed,
    )
    units = {"N": "N m", "psi": "rad", "r": "rad/s"}
    return Trial("sagging", {n: Channel(n, u, table["t"], table[n]) for n, u in units.items()})


def test_the_end_of_a_run_is_predicted_with_the_battery_drift_at_that_time() -> None:
    settings = StudySettings(effects=("gain-drift",))
    found = study([drifting(1)], [], settings, "now")
    assert found.answer.unseen is not None
    for statistics in found.answer.unseen.statistics:
        assert statistics.rms < 0.013
