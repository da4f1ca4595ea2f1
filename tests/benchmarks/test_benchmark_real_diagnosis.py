"""Real runs diagnosed: a command is the share of full output that the servos of the same record show."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.real_diagnosis.cases import CASES, DATA

SPAN = 400.0
"""A motor's pulse [us] from neutral to full."""


@pytest.mark.skipif(not (DATA / "ardupilot_sitl").is_dir(), reason="the recorded runs are not on this machine")
@pytest.mark.parametrize(("name", "force", "servo"), [("sub-yaw", "N", "s1"), ("sub-depth", "Z", "s5")])
def test_a_subs_commands_are_shares_of_what_its_motors_can_do(name: str, force: str, servo: str) -> None:
    loaded = CASES[name].load()
    assert [len(runs) for runs in loaded] == [1, 1]
    for runs in loaded:
        for run in runs:
            share, pulse = run[force], run[servo]
            shown = (np.interp(share.t, pulse.t, pulse.values) - 1500.0) / SPAN
            assert share.unit == "1"
            assert np.median(np.abs(share.values - shown)) == pytest.approx(0.0, abs=1e-9), run.name
            assert np.max(np.abs(share.values)) == pytest.approx(np.max(np.abs(shown)))
