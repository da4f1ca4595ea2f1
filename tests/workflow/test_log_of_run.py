"""``--fetch-log``: the vehicle's own log of a run is fetched and identified after everything is restored."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import GuardTripped, OperatorStopped, PreconditionFailed
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.workflow import FlySettings, Unattended, experiment, fly
from gcs_autotune.workflow.flight_plan import FlightRun

from .sitl_harness import WHEN, Ear, SitlHarness

FLOWN = gzip.decompress((Path(__file__).parents[1] / "logs" / "flown" / "charlie.bin.gz").read_bytes())
"""What ArduPilot itself logged of a relay of Charlie's."""
OLD, NEW = 3, 4


class CardAboard:
    """A vehicle that keeps logs: one from before, and one of every time it was armed, listed only while disarmed."""

    def __init__(self, harness: SitlHarness, *, writes: bool = True) -> None:
        self._peer, self._autopilot, self._writes = harness.peer, harness.vehicle.autopilot, writes
        self._ear, self._mouth = mavlink.MAVLink(None), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._out: list[Any] = []
        self._was_armed = False
        self.armed_when_asked: list[bool] = []
        self.data_asked = 0

    def receive(self, data: bytes) -> None:
        for message in self._ear.parse_buffer(data) or ():
            kind = message.get_type()
            if kind in ("LOG_REQUEST_LIST", "LOG_REQUEST_DATA"):
                self.armed_when_asked.append(bool(self._autopilot.armed))
                if not self._autopilot.armed:
                    self._answer(message)
        self._peer.receive(data)

    def _answer(self, message: Any) -> None:
        if message.get_type() == "LOG_REQUEST_LIST":
            logs = {OLD: 1000, **({NEW: len(FLOWN)} if self._was_armed and self._writes else {})}
            for number, size in logs.items():
                self._out.append(mavlink.MAVLink_log_entry_message(number, len(logs), max(logs), 1_790_000_000, size))
            return
        self.data_asked += 1
        for offset in range(message.ofs, min(message.ofs + message.count, len(FLOWN)), 90):
            piece = FLOWN[offset : offset + 90]
            self._out.append(
                mavlink.MAVLink_log_data_message(message.id, offset, len(piece), list(piece.ljust(90, b"\0")))
            )

    def advance_to(self, t: float) -> bytes:
        data = self._peer.advance_to(t)
        self._was_armed |= bool(self._autopilot.armed)
        for message in self._out:
            data += message.pack(self._mouth)
            self._mouth.seq = (self._mouth.seq + 1) % 256
        self._out.clear()
        return data


class StopsWhenAsked(Unattended):
    """An operator who stops once *when* returns true."""

    def __init__(self, when: Any) -> None:
        self._when = when

    def stop_requested(self) -> bool:
        return bool(self._when())


def with_a_card(tmp_path: Path, **card: Any) -> tuple[SitlHarness, CardAboard]:
    harness = SitlHarness(tmp_path, "charlie")
    aboard = CardAboard(harness, **card)
    harness.peer = aboard  # type: ignore[assignment]
    return harness, aboard


def circle(harness: SitlHarness, operator: Any = None, **changes: Any) -> Any:
    """Fly a short turn, the quickest thing there is."""
    common = harness.common(fetch_log=True, **changes)
    settings = FlySettings("steps", common, {"duration": 10.0})
    return fly(settings, operator or Unattended(), Ear(harness.said), WHEN)


def assert_left(harness: SitlHarness) -> None:
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    assert harness.mode == "HOLD"


@pytest.mark.slow
def test_the_log_of_the_run_is_fetched_and_identified_with_the_telemetry(tmp_path: Path) -> None:
    harness, card = with_a_card(tmp_path)
    fit = experiment(harness.settings(fetch_log=True), Unattended(), Ear(harness.said), WHEN)
    assert (harness.directory / f"onboard-{NEW}.bin").read_bytes() == FLOWN
    assert card.armed_when_asked and not any(card.armed_when_asked)
    found = json.loads((harness.directory / "fit-onboard.json").read_text())
    assert found["dof"] == fit.dof == "yaw"
    assert (harness.directory / "onboard.html").stat().st_size > 1000
    announced = "\n".join(harness.said)
    assert "yaw, from telemetry and from the onboard log" in announced
    assert "alpha_r" in announced and "standard errors apart" in announced
    assert_left(harness)


def test_a_vehicle_that_lists_no_logs_is_refused_before_anything_is_armed(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "charlie")
    with pytest.raises(PreconditionFailed, match=r"--fetch-log: .* did not list its logs.*Nothing was armed"):
        circle(harness)
    assert not any(text.startswith("State before the run: mode") for text in harness.said)
    assert_left(harness)


def test_a_missing_log_is_reported_and_the_run_stays_valid(tmp_path: Path) -> None:
    harness, _ = with_a_card(tmp_path, writes=False)
    assert circle(harness).page.exists()
    assert any("wrote no log of this run" in text for text in harness.said)
    assert not list(harness.directory.glob("onboard*"))


def test_a_stop_in_flight_fetches_nothing_and_shows_the_command_for_later(tmp_path: Path) -> None:
    harness, card = with_a_card(tmp_path)
    operator = StopsWhenAsked(lambda: any(text.startswith("State before the run: mode") for text in harness.said))
    with pytest.raises(OperatorStopped):
        circle(harness, operator)
    assert card.data_asked == 0
    assert any("`gcs-autotune logs fetch`" in text for text in harness.said)
    assert_left(harness)


def test_a_stop_during_the_download_ends_only_the_download(tmp_path: Path) -> None:
    harness, card = with_a_card(tmp_path)
    assert circle(harness, StopsWhenAsked(lambda: card.data_asked > 2)).page.exists()
    assert card.data_asked > 2
    assert any("not fetched completely" in text for text in harness.said)
    assert not list(harness.directory.glob("onboard*"))
    assert_left(harness)


def test_the_log_of_a_run_ended_by_a_limit_is_fetched_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    harness, _ = with_a_card(tmp_path)
    monkeypatch.setattr(FlightRun, "why_not", "")  # nobody foresaw that it would take so long
    with pytest.raises(GuardTripped):
        circle(harness, envelope=Envelope(time=8.0))
    assert (harness.directory / f"onboard-{NEW}.bin").read_bytes() == FLOWN
    assert_left(harness)
