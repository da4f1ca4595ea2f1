"""A silence of some seconds before anything is armed is waited out, up to --patience."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.faults import Case, Fault, run_case
from benchmarks.faults.case import FLEET

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("begins", [3.0, 5.0, 7.0, 9.0])
def test_a_silence_of_four_seconds_before_arming_is_waited_out(begins: float, tmp_path: Path) -> None:
    outcome = run_case(Case.of(FLEET[0], Fault("silence", begins, 4.0), has_receiver=True), tmp_path)
    assert outcome.failures == []
    assert outcome.ending == "kept", outcome.message
