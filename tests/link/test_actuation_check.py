"""Outputs requested, overrides checked, the steering twitched: how often, how long, and when it is given up."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import NotAsFound, PreconditionFailed
from gcs_autotune.firmware import FIRMWARE, ServoMap
from gcs_autotune.link import Session, read_outputs
from gcs_autotune.link.vehicle import actuation_check
from gcs_autotune.link.vehicle.actuation_check import await_neutral, check_outputs_follow, check_overrides_taken
from gcs_autotune.link.vehicle.setpoint_streamer import FOLLOW_TIMEOUT
from gcs_autotune.link.vehicle.telemetry import Telemetry


class OutputSession:
    """A session: each request is answered with the next number of SERVO_OUTPUT_RAW of *answers*, on *port*."""

    def __init__(self, answers: list[int], port: int = 0) -> None:
        self.answers, self.notes, self.waits = answers, list[str](), list[float]()
        self.message_port, self.requests, self.count = port, 0, 0
        self.listener: Callable[[Any], None] | None = None
        self.port = SimpleNamespace(system=255)

    def listen(self, name: str, listener: Callable[[Any], None]) -> Callable[[], None]:
        assert name == "SERVO_OUTPUT_RAW"
        self.listener = listener
        return lambda: setattr(self, "listener", None)

    def request_message(self, number: int) -> None:
        assert number == 36
        self.requests += 1

    def wait_for(self, found: Callable[[], Any], timeout: float) -> Any:
        self.waits.append(timeout)
        for _ in range(self.answers.pop(0) if self.answers else 0):
            self.count += 1
            assert self.listener is not None
            pulses = {f"servo{n}_raw": 1000 * n + self.count for n in range(1, 9)}
            self.listener(SimpleNamespace(port=self.message_port, **pulses))
        return found()


SERVOS = cast(ServoMap, SimpleNamespace(forces=lambda raw: {"first": float(raw[0]), "last": float(raw[-1])}))


def read(session: OutputSession) -> dict[str, float]:
    return read_outputs(cast(Any, session), SERVOS)


@pytest.mark.parametrize(
    ("answers", "requests"),
    [([2], 1), ([1, 1], 2), ([0, 1, 0, 1], 4), ([5], 1)],
    ids=["two", "one by one", "gaps", "many"],
)
def test_outputs_are_requested_until_two_arrive_and_the_newest_is_used(answers: list[int], requests: int) -> None:
    heard = sum(answers)
    session = OutputSession(answers)
    assert read(session) == {"first": 1000.0 + heard, "last": 8000.0 + heard}
    assert session.requests == requests
    assert session.listener is None, "its listener is removed"


def test_outputs_that_do_not_arrive_are_requested_for_five_seconds() -> None:
    session = OutputSession([])
    assert read(session) == {}
    assert session.requests == 10 and sum(session.waits) == 5.0
    assert read(OutputSession([1])) == {"first": 1001.0, "last": 8001.0}, "one message is used if no second arrives"
    assert read(OutputSession([3], port=1)) == {}, "the second bank of outputs is another"


class Streamer:
    """What is commanded, and what the outputs show of it a moment later."""

    def __init__(self, *, follows: float = 1.0, late: int = 0, taken: bool = True) -> None:
        self.clock = ManualClock()
        self.taken, self.is_obeyed, self.differing = taken, taken, "channel 1 at 1500 us"
        self.sent: list[float] = []
        self.rested = 0
        self.outputs: dict[str, float] = {}
        self._follows, self._late, self._since = follows, late, 0

    def command(self, command: Any) -> None:
        self.sent.append(command.N)
        self._since = 0

    def observe(self) -> None:
        self.clock.advance_to(self.clock.now() + 0.1)
        self._since += 1
        if self._since > self._late:
            self.outputs["N"] = self._follows * self.sent[-1]

    def probe_override(self) -> bool:
        return self.taken

    def rest(self) -> None:
        self.rested += 1


def twitch(streamer: Streamer) -> None:
    check_outputs_follow(cast(Any, streamer), cast(Any, streamer), streamer.observe, "MANUAL")


@pytest.mark.parametrize("follows", [1.0, 1.49, 0.51])
def test_steering_that_follows_within_half_a_twitch_is_moved_twice_each_way(follows: float) -> None:
    streamer = Streamer(follows=follows, late=3)
    twitch(streamer)
    assert streamer.sent == [0.05, -0.05, 0.05, -0.05, 0.0]


def test_two_thrusters_whose_small_outputs_are_enlarged_by_the_autopilot_follow() -> None:
    streamer = Streamer(follows=4.8)  # MOT_THR_MIN 20
    check_outputs_follow(cast(Any, streamer), cast(Any, streamer), streamer.observe, "MANUAL", skid=True)
    assert streamer.sent == [0.05, -0.05, 0.05, -0.05, 0.0]
    for wrong in (-4.8, 0.4):
        with pytest.raises(PreconditionFailed, match="does not follow"):
            streamer = Streamer(follows=wrong)
            check_outputs_follow(cast(Any, streamer), cast(Any, streamer), streamer.observe, "MANUAL", skid=True)


@pytest.mark.parametrize("follows", [0.0, 0.49, 1.51, -1.0])
def test_steering_that_does_not_follow_is_reported_after_the_timeout(follows: float) -> None:
    streamer = Streamer(follows=follows)
    with pytest.raises(PreconditionFailed, match=r"\+5% was sent, RC_CHANNELS shows the overrides, but") as caught:
        twitch(streamer)
    assert f"SERVO_OUTPUT_RAW shows {follows * 0.05:+.0%} in MANUAL" in str(caught.value)
    assert FOLLOW_TIMEOUT <= streamer.clock.now() < FOLLOW_TIMEOUT + 0.15
    deaf = Streamer(late=10_000, taken=False)
    with pytest.raises(PreconditionFailed, match="neither RC_CHANNELS nor SERVO_OUTPUT_RAW shows it"):
        twitch(deaf)


def look(streamer: Streamer, before: int, after: int, monkeypatch: pytest.MonkeyPatch) -> OutputSession:
    session, rc_monitor = OutputSession([]), SimpleNamespace(count=before)
    monkeypatch.setattr(streamer, "probe_override", lambda: setattr(rc_monitor, "count", after) or streamer.taken)
    monkeypatch.setattr(actuation_check, "why_deaf", lambda parameters, firmware, system: f"asked as {system}")
    check_overrides_taken(
        cast(Any, session), cast(Any, streamer), cast(Any, rc_monitor), cast(Any, None), FIRMWARE["ardurover"]
    )
    return session


def test_accepted_overrides_are_released_and_awaited_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    streamer = Streamer()
    session = look(streamer, 3, 9, monkeypatch)
    assert (streamer.rested, session.waits, session.notes) == (1, [1.0], [])


class Outputs:
    """A session and its telemetry in one: outputs received every 0.1 s, from *silent* seconds on."""

    def __init__(self, outputs: dict[str, float], silent: float = 0.0) -> None:
        self.clock = self.liveness = ManualClock()
        self.outputs, self.output_ticks, self.silent = outputs, 0, silent
        self.asked = 0

    def request_message(self, number: int) -> None:
        assert number == 36
        self.asked += 1

    def wait_for(self, seen: Callable[[], Any], timeout: float) -> Any:
        end = self.clock.now() + timeout
        while self.clock.now() < end:
            self.clock.advance_to(end if end - self.clock.now() < 0.11 else self.clock.now() + 0.1)
            if self.clock.now() >= self.silent:
                self.output_ticks += 1
            found = seen()
            if found is not None:
                return found
        return None


def wait_on(vehicle: Outputs) -> None:
    await_neutral(cast(Session, vehicle), cast(Telemetry, vehicle))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_three_per_cent_output_is_neutral_and_more_in_either_direction_is_not(sign: float) -> None:
    vehicle = Outputs({"N": 0.0, "X": sign * 0.03})
    wait_on(vehicle)
    assert vehicle.clock.now() == pytest.approx(0.2), "the message after next: the first may have been under way"
    with pytest.raises(NotAsFound, match="not neutral after 5 s: X") as caught:
        wait_on(Outputs({"N": 0.0, "X": sign * 0.031}))
    assert set(caught.value.differences) == {"X"}


def test_missing_outputs_are_requested_and_never_taken_for_neutral() -> None:
    vehicle = Outputs({"N": 0.0}, silent=2.05)
    wait_on(vehicle)
    assert vehicle.asked == 4
    with pytest.raises(NotAsFound, match="outputs no longer reported") as caught:
        wait_on(Outputs({"N": 0.0}, silent=99.0))
    assert set(caught.value.differences) == {"outputs"}
