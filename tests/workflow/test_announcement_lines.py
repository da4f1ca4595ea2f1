"""The announcement on a terminal of 80 columns: a line per row, and nothing is moved after a no."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.errors import OperatorStopped
from gcs_autotune.observer import Fact, Intentions
from gcs_autotune.tunables import tunable
from gcs_autotune.workflow import Unattended, job_of

from .sitl_harness import WHEN, Ear, SitlHarness


class Notes(Ear):
    """Remembers the announcement."""

    def note(self, fact: Fact) -> None:
        if isinstance(fact, Intentions):
            self.announced = fact


@pytest.mark.parametrize(
    ("vehicle", "what"),
    [
        ("blueboat", "heading"),
        ("charlie", "speed"),
        ("charlie", "line"),
        ("blueboat", "actuators"),
        ("bluerov2", "depth"),
        ("bluerov2-6dof", "roll"),
        ("bluerov2-sway", "position"),
    ],
)
def test_each_row_is_one_line_of_80_columns(tmp_path: Path, vehicle: str, what: str) -> None:
    harness = SitlHarness(tmp_path, vehicle)
    observer = Notes(harness.said)
    settings = harness.settings(tunable(what).axis, simulated=False, untuned=what == "line")
    with pytest.raises(OperatorStopped, match="Nothing was armed, moved or written"):
        job_of(what).run(settings, Unattended(answer=False), observer, WHEN)
    rows = [intention for intention in observer.announced.each if intention.row]
    assert {"Arms", "Moves", "Space", "Time", "Battery", "Writes"} <= {each.row for each in rows}
    first = max(len(each.row) for each in rows) + 2
    assert [each.brief for each in rows if first + len(each.brief.replace(" deg", "°")) > 80] == []
    (moves,) = [each for each in rows if each.row == "Moves"]
    # a buoyant ROV that is deep enough now may rise during the run
    dives = what in ("depth", "roll")
    assert ("dive to 1.5 m whenever it is shallower than 1 m" in moves.text) is dives
    assert ("dive to 1.5 m if shallow" in moves.brief) is dives
    harness.assert_neutral()


def test_a_battery_without_a_monitor_is_announced_as_not_monitored(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat", parameters={"BATT_MONITOR": 0.0})
    observer = Notes(harness.said)
    with pytest.raises(OperatorStopped):
        job_of("heading").run(harness.settings(simulated=False), Unattended(answer=False), observer, WHEN)
    (row,) = [intention.brief for intention in observer.announced.each if intention.row == "Battery"]
    assert row.endswith("(not reported, so not monitored)")
