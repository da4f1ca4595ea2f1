"""A harness for testing whole jobs: a simulated vehicle on a memory link, and a meddler on the link.

The only place besides the benchmarks where tuner and simulator meet in one process, and only by bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import MemoryLink, Transport
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import CommonSettings, Connection, TuneSettings, Unattended, tune
from sitl import Server, open_vehicle

WHEN = "2026-11-20T12:00:00"
QUICK = "blueboat"
"""A boat that responds within a second: its tune takes half the time of Charlie's."""
SLOW_LOOP: Mapping[str, Any] = {"parameters": {"SCHED_LOOP_RATE": 100.0}}
"""Options of a simulated ArduSub whose 400 Hz do not matter: a quarter of the work."""
Meddling = Callable[[float, Any], Iterable[Any]]
"""(simulated time, message from the vehicle) -> the messages that get through."""


class Meddler:
    """Stands between vehicle and ground: every message of the vehicle passes through *meddling*."""

    def __init__(self, server: Server, meddling: Meddling | None = None) -> None:
        self.server = server
        self.deaf = False
        self._meddling = meddling
        self._ear = mavlink.MAVLink(None)
        self._mouth = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def receive(self, data: bytes) -> None:
        if not self.deaf:
            self.server.receive(data)

    def advance_to(self, t: float) -> bytes:
        data = self.server.advance_to(t)
        if self._meddling is None:
            return data
        out = b""
        for message in self._ear.parse_buffer(data) or ():
            for passed in self._meddling(t, message):
                out += passed.pack(self._mouth)
                self._mouth.seq = (self._mouth.seq + 1) % 256
        return out


class Later:
    """The same vehicle, met again by a ground station whose own clock starts at zero."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._offset = server.now

    def receive(self, data: bytes) -> None:
        self._server.receive(data)

    def advance_to(self, t: float) -> bytes:
        return self._server.advance_to(self._offset + t)


@dataclass(frozen=True)
class Moored(Connection):
    """A connection to a vehicle in this process."""

    uri: str = "memory"
    peer: Any = None
    simulated: bool = True

    def open(self) -> Transport:
        link = MemoryLink(self.peer)
        link.is_simulated = self.simulated
        return link


class SitlHarness:
    """One vehicle, how it was found, and a place for the run."""

    def __init__(self, tmp_path: Path, name: str = "charlie", meddling: Meddling | None = None, **options: Any) -> None:
        self.server = open_vehicle(name, **{"seed": 1, **options})
        self.peer = Meddler(self.server, meddling)
        self.directory = tmp_path / "run"
        self.parameters = dict(self.vehicle.parameters.values)
        self.said: list[str] = []

    @property
    def vehicle(self) -> Any:
        return self.server.vehicle

    @property
    def mode(self) -> str:
        """The mode it is in."""
        number = self.vehicle.autopilot.mode.number
        return FIRMWARE["ardurover" if self.vehicle.data.is_boat else "ardusub"].mode_name(number)

    @property
    def found(self) -> str:
        """The original mode, as the workflow announced it; empty when it never got so far."""
        return next((t.split()[5].rstrip(",") for t in self.said if t.startswith("State before the run: mode")), "")

    def settings(self, axis: str = "heading", *, simulated: bool = True, **changes: Any) -> TuneSettings:
        connection = Moored(peer=self.peer, simulated=simulated)
        return TuneSettings(connection, self.directory, axis=axis, **changes)

    def common(self, *, simulated: bool = True, **changes: Any) -> CommonSettings:
        return CommonSettings(Moored(peer=self.peer, simulated=simulated), self.directory, **changes)

    def tune(self, operator: Any = None, axis: str = "heading", **changes: Any) -> Any:
        return tune(self.settings(axis, **changes), operator or Unattended(), Ear(self.said), WHEN)

    def assert_as_found(self) -> None:
        """Neutral, disarmed, the old mode, the old parameters, and the record on disk."""
        self.assert_untouched()
        self.assert_recorded()

    def assert_untouched(self) -> None:
        """Neutral, disarmed, the old mode, the old parameters."""
        self.assert_neutral()
        assert not self.vehicle.autopilot.armed
        assert self.found in ("", self.mode)
        assert dict(self.vehicle.parameters.values) == self.parameters

    def assert_restored(self) -> None:
        """As :meth:`assert_untouched`, of a vehicle whose state was recorded."""
        assert self.found
        self.assert_untouched()

    def assert_neutral(self) -> None:
        assert all(pwm in (0, 1500) for pwm in self.vehicle.autopilot.pwm)

    def assert_recorded(self) -> None:
        assert (self.directory / "report.html").stat().st_size > 1000
        assert (self.directory / "summary.json").exists()
        assert (self.directory / "telemetry.tlog").exists()


class Ear(SilentObserver):
    """Remembers the announcements."""

    def __init__(self, announced: list[str]) -> None:
        self._said = announced

    def say(self, text: str) -> None:
        self._said.append(text)


class StopsAt:
    """An operator who presses Ctrl-C at the n-th time of being asked."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.asked = 0

    def stop_requested(self) -> bool:
        self.asked += 1
        return self.asked >= self.n

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        return True


class Answers:
    """An operator with an answer for each question, who takes a second of the link's time to think."""

    def __init__(self, *answers: bool) -> None:
        self.answers = list(answers)
        self.questions: list[str] = []

    def stop_requested(self) -> bool:
        return False

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        self.questions.append(question)
        for _ in range(40):
            while_waiting()
        return self.answers.pop(0)
