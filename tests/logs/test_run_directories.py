"""Run directories: relays, with the commands of the lead-in before them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs_autotune.logs import load_runs
from gcs_autotune.trial import Channel, Trial, save_trial


def trial(start: float, meta: dict[str, object]) -> Trial:
    t = np.arange(start, 20.0, 0.5)
    N = np.where(t < 10.0, 0.0, 0.3)
    channels = {"N": Channel("N", "1", t, N), "psi": Channel("psi", "rad", t, 0.1 * t)}
    return Trial("relay-1", channels, meta=meta)


def test_a_relay_brings_what_its_inputs_were_during_the_lead_in(tmp_path: Path) -> None:
    folder = tmp_path / "trials"
    folder.mkdir()
    save_trial(trial(10.0, {"manoeuvre": "relay"}), folder / "01-relay-1.csv")
    save_trial(trial(2.0, {}), folder / "01-relay-1-with-lead-in.csv")
    (run,) = load_runs(tmp_path)
    assert (run["N"].t[0], run["N"].values[0], run["psi"].t[0]) == (2.0, 0.0, 10.0)
    (folder / "01-relay-1-with-lead-in.csv").unlink()
    (run,) = load_runs(tmp_path)
    assert run["N"].t[0] == 10.0
