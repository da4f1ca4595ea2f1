"""``aboard``: from the upload of the script to the identified model, and back, on every ending."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.cli import main
from gcs_autotune.errors import AutotuneError, GuardTripped, NoReply, OperatorStopped, PreconditionFailed, UsageError
from gcs_autotune.link import Journal
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.workflow import AboardSettings, Unattended, fly_aboard

from ..link.narrow import Narrow
from .lua_autopilot import LuaHost
from .sitl_harness import WHEN, Ear, SitlHarness

HOLD = 4
SLOW = 650.0
"""Bytes/s of a link too slow for `experiment`; its answers take 0.6 s and more."""


class Card:
    """A vehicle whose log is what its scripts have logged. It sends logs only while disarmed."""

    def __init__(self, harness: SitlHarness, host: LuaHost) -> None:
        self._peer, self._autopilot, self._host = harness.peer, harness.vehicle.autopilot, host
        self._ear, self._mouth = mavlink.MAVLink(None), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._out: list[Any] = []
        self.watch: Callable[[], object] = lambda: None
        self.lost_until = 0.0

    @property
    def _is_lost(self) -> bool:
        return self._autopilot.ms < 1e3 * self.lost_until

    def receive(self, data: bytes) -> None:
        if self._is_lost:
            return
        for message in self._ear.parse_buffer(data) or ():
            log = bytes(self._host.log)
            if message.get_type() == "LOG_REQUEST_LIST" and not self._autopilot.armed:
                self._out.append(mavlink.MAVLink_log_entry_message(1, 1, 1, 1_790_000_000, len(log)))
            if message.get_type() == "LOG_REQUEST_DATA" and not self._autopilot.armed:
                for offset in range(message.ofs, min(message.ofs + message.count, len(log)), 90):
                    piece = log[offset : offset + 90]
                    padded = list(piece.ljust(90, b"\0"))
                    self._out.append(mavlink.MAVLink_log_data_message(1, offset, len(piece), padded))
        self._peer.receive(data)

    def advance_to(self, t: float) -> bytes:
        data = self._peer.advance_to(t)
        self.watch()
        if self._is_lost:
            return b""
        for message in self._out:
            data += message.pack(self._mouth)
            self._mouth.seq = (self._mouth.seq + 1) % 256
        self._out.clear()
        return data


class Scripted(SitlHarness):
    """A simulated vehicle whose autopilot runs scripts."""

    def __init__(self, tmp_path: Path, name: str = "charlie", *, hosted: bool = True, rate: float = 0.0, **own: Any):
        super().__init__(tmp_path, name, parameters={"SCR_ENABLE": 1, "SIM_RC_FAIL": 1, **own})
        self.host = LuaHost(self.vehicle)
        if not hosted:
            self.vehicle.autopilot.scripts = None
        self.card = Card(self, self.host)
        self.peer = Narrow(self.card, rate=rate, latency=0.3, jitter=0.2) if rate else self.card  # type: ignore[assignment]

    def aboard(self, axis: str = "heading", operator: Any = None, silence: float = 10.0, **changes: Any) -> Any:
        settings = AboardSettings(self.settings(axis, **changes), silence)
        return fly_aboard(settings, operator or Unattended(), Ear(self.said), WHEN)

    def when(self, begins: str, act: Callable[[], object]) -> None:
        """Do *act* once, some seconds after the script has announced part *begins*."""
        seen: list[float] = []

        def watch() -> None:
            texts = any(text.startswith(begins) for text in self.said)
            if texts and not seen:
                seen.append(self.vehicle.seconds)
            if len(seen) == 1 and self.vehicle.seconds > seen[0] + 5.0:
                seen.append(0.0)
                act()

        self.card.watch = watch

    def assert_gone(self) -> None:
        """No script is left, and the journal is closed."""
        assert self.vehicle.card == {}
        assert Journal.read(self.directory / "journal.jsonl").is_settled
        self.assert_neutral()


TRUTH = {"alpha_r": 16.361, "beta_r": 4.909}
"""Charlie at 80 % throttle."""
FIRST = "first self-oscillation"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    harness = Scripted(tmp_path_factory.mktemp("flown"))
    return harness, harness.aboard()


@pytest.mark.slow
def test_a_boat_is_identified_from_the_log_of_its_script(flown):
    assert_identified(*flown)


@pytest.mark.slow
def test_a_boat_on_a_slow_link_is_identified_from_the_log_of_its_script(tmp_path):
    harness = Scripted(tmp_path, rate=SLOW)
    assert_identified(harness, harness.aboard())


def assert_identified(harness, fit):
    for name, truth in TRUTH.items():
        assert fit.parameters[name].value == pytest.approx(truth, rel=0.02)
    harness.assert_gone()
    harness.assert_restored()
    names = sorted(path.name for path in (harness.directory / "trials").glob("*.csv"))
    assert names == ["01-relay-1.csv", "02-relay-2.csv", "03-step-1.csv"]
    assert json.loads((harness.directory / "fit.json").read_text())["dof"] == "yaw"
    assert (harness.directory / "report.html").stat().st_size > 1000
    relay, second, step = load_runs(harness.directory)
    assert relay.meta["C"] == pytest.approx(0.3) and second.meta["C"] == pytest.approx(0.6)
    assert (relay.ending, second.ending, step.ending) == ("completed",) * 3


@pytest.mark.slow
def test_the_run_and_its_log_alone_can_be_identified(flown, capsys):
    harness, fit = flown
    capsys.readouterr()
    for source in (harness.directory, harness.directory / "onboard-1.bin"):
        assert main(["identify", str(source), "--dof", "yaw", "--structure", fit.structure, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)["parameters"]
        assert found["alpha_r"]["value"] == pytest.approx(fit.parameters["alpha_r"].value, rel=0.05)


@pytest.mark.slow
def test_an_rov_with_a_late_position_estimate_is_identified_in_depth(tmp_path):
    harness = Scripted(tmp_path, "falcon", SCHED_LOOP_RATE=100.0)
    harness.host.has_position = False
    harness.when("second self-oscillation", lambda: setattr(harness.host, "has_position", True))
    fit = harness.aboard("depth")
    assert fit.dof == "heave"
    harness.assert_gone()
    harness.assert_restored()


@pytest.mark.slow
def test_a_silent_link_does_not_end_the_script(tmp_path):
    harness = Scripted(tmp_path, SIM_RC_FAIL=0)
    harness.when(FIRST, lambda: setattr(harness.card, "lost_until", harness.vehicle.seconds + 12.0))
    fit = harness.aboard(silence=0.0)
    assert fit.parameters["alpha_r"].value == pytest.approx(TRUTH["alpha_r"], rel=0.02)
    assert any("The script flies on or ends by itself" in text for text in harness.said)
    harness.assert_gone()
    harness.assert_restored()


def test_a_silence_longer_than_permitted_ends_the_script(tmp_path):
    harness = Scripted(tmp_path, SIM_RC_FAIL=0)
    harness.when(FIRST, lambda: setattr(harness.card, "lost_until", harness.vehicle.seconds + 12.0))
    with pytest.raises(GuardTripped, match=r"lost contact with the ground station.*--silence"):
        harness.aboard(silence=6.0)
    harness.assert_gone()
    harness.assert_restored()


def test_a_stop_ends_the_script_and_everything_is_restored(tmp_path):
    harness = Scripted(tmp_path)

    class Stops(Unattended):
        def stop_requested(self) -> bool:
            return any(text.startswith(FIRST) for text in harness.said)

    with pytest.raises(OperatorStopped):
        harness.aboard(operator=Stops())
    harness.assert_gone()
    harness.assert_restored()


def test_a_mode_set_by_another_station_ends_the_script_and_stays(tmp_path):
    harness = Scripted(tmp_path)
    harness.when(FIRST, lambda: harness.vehicle.autopilot.set_mode(HOLD))
    with pytest.raises(GuardTripped, match="HOLD"):
        harness.aboard()
    assert harness.vehicle.card == {}
    harness.assert_neutral()
    assert harness.vehicle.autopilot.mode.number == HOLD


def test_a_moved_stick_ends_the_script_and_leaves_control_to_the_pilot(tmp_path):
    harness = Scripted(tmp_path, SIM_RC_FAIL=0)
    harness.when(FIRST, lambda: harness.host.moved.update({3: 1620}))
    with pytest.raises(GuardTripped, match="a stick was moved"):
        harness.aboard()
    assert harness.vehicle.autopilot.armed
    assert harness.mode == "MANUAL"
    assert harness.vehicle.card == {}
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    assert any("This tool does not change mode or armed state again" in text for text in harness.said)


def test_a_limit_ends_the_script_with_its_cure(tmp_path):
    harness = Scripted(tmp_path)
    harness.when(FIRST, lambda: setattr(harness.host, "charge", 5.0))
    with pytest.raises(GuardTripped, match=r"battery charge was too low.*Charge the battery"):
        harness.aboard()
    harness.assert_gone()
    harness.assert_restored()
    (relay,) = load_runs(harness.directory)
    assert relay.ending == "aborted"


def test_a_failing_script_is_reported_and_removed(tmp_path):
    harness = Scripted(tmp_path)
    harness.when(FIRST, lambda: setattr(harness.host, "breaches", None))
    with pytest.raises(AutotuneError):
        harness.aboard()
    harness.assert_gone()
    harness.assert_restored()


REFUSED = {
    "scripting off": ({"SCR_ENABLE": 0}, {}, PreconditionFailed, "Set SCR_ENABLE to 1 and restart"),
    "little memory": ({"SCR_HEAP_SIZE": 40000}, {}, PreconditionFailed, "SCR_HEAP_SIZE is 40000 bytes"),
    "no scripts from the card": ({"SCR_DIR_DISABLE": 2}, {}, PreconditionFailed, "SCR_DIR_DISABLE"),
    "no free parameter": ({f"SCR_USER{n}": 1 for n in range(1, 7)}, {}, PreconditionFailed, "SCR_USERn"),
    "a limit that the flight exceeds": (
        {},
        {"envelope": Envelope(turn_rate=0.02)},
        PreconditionFailed,
        "--max-turn-rate",
    ),
    "speed": ({}, {"axis": "speed"}, UsageError, "gcs-autotune experiment speed"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_an_impossible_script_is_refused_before_anything_is_armed(tmp_path, what):
    own, options, error, words = REFUSED[what]
    harness = Scripted(tmp_path, **own)
    with pytest.raises(error, match=words):
        harness.aboard(**options)
    harness.assert_untouched()
    assert harness.vehicle.card == {}


def test_a_vehicle_without_ftp_is_refused(tmp_path, monkeypatch):
    harness = Scripted(tmp_path)
    monkeypatch.setattr(harness.server.files, "handle", lambda message: None)
    with pytest.raises(NoReply, match="MAVLink FTP"):
        harness.aboard()
    harness.assert_untouched()


def test_a_script_that_does_not_load_is_removed_and_nothing_is_armed(tmp_path):
    harness = Scripted(tmp_path, hosted=False)
    with pytest.raises(PreconditionFailed, match=r"the script does not run.*restart it"):
        harness.aboard()
    harness.assert_gone()
    harness.assert_restored()
