"""Small parts of the link at their limits: neutral outputs, silence, float32, the watchdog, files of parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from gcs_autotune.clock import ManualClock
from gcs_autotune.errors import BadFile, NotAsFound, TelemetryFault, UsageError
from gcs_autotune.link import Session
from gcs_autotune.link.liveness import Liveness
from gcs_autotune.link.parameters.exchange import as_float32, encoded, same_float32
from gcs_autotune.link.vehicle.actuation_check import await_neutral
from gcs_autotune.link.vehicle.telemetry import Telemetry
from gcs_autotune.link.vehicle.watchdog import Watchdog
from gcs_autotune.mavlink import load_params

# --- neutral --------------------------------------------------------------------------------


class Outputs:
    """A session and its telemetry in one: outputs heard every 0.1 s, from *silent* seconds on."""

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
def test_three_per_cent_of_full_output_is_neutral_and_more_either_way_is_not(sign: float) -> None:
    vehicle = Outputs({"N": 0.0, "X": sign * 0.03})
    wait_on(vehicle)
    assert vehicle.clock.now() == pytest.approx(0.2), "the message after next: the first may have been under way"
    with pytest.raises(NotAsFound, match="not neutral after 5 s: X") as caught:
        wait_on(Outputs({"N": 0.0, "X": sign * 0.031}))
    assert set(caught.value.differences) == {"X"}


def test_outputs_that_are_not_heard_are_asked_for_and_never_taken_for_neutral() -> None:
    vehicle = Outputs({"N": 0.0}, silent=2.05)
    wait_on(vehicle)
    assert vehicle.asked == 4
    with pytest.raises(NotAsFound, match="outputs no longer reported") as caught:
        wait_on(Outputs({"N": 0.0}, silent=99.0))
    assert set(caught.value.differences) == {"outputs"}


# --- silence --------------------------------------------------------------------------------


def test_only_what_was_listened_to_counts_as_silence() -> None:
    """Half a second from pump to pump at most: longer, it was we who were away."""
    hearing = Liveness(100.0)
    hearing.count(100.4)
    assert (hearing.listened, hearing.silence) == (pytest.approx(0.4), pytest.approx(0.4))
    hearing.count(160.4)
    assert hearing.silence == pytest.approx(0.9)
    hearing.heard()
    hearing.count(160.6)
    assert (hearing.listened, hearing.silence) == (pytest.approx(1.1), pytest.approx(0.2))
    hearing.bear(20.0)
    assert hearing.silence == pytest.approx(-20.0)


@pytest.mark.parametrize(("silence", "is_kept"), [(0.5, False), (0.51, True)])
def test_the_longest_silence_is_of_those_worth_keeping_that_ended_in_the_span(silence: float, is_kept: bool) -> None:
    liveness = Liveness(0.0)

    def listen(until: float) -> None:
        now = begun[0]
        while now < until - 1e-9:
            now = min(now + 0.3, until)
            liveness.count(now)
        begun[0] = until

    begun = [0.0]
    listen(silence)
    liveness.heard()
    listen(silence + 0.2)
    liveness.heard()
    assert liveness.longest(10.0) == (pytest.approx(silence) if is_kept else 0.0)
    listen(silence + 5.0)
    assert liveness.longest(5.1) == (pytest.approx(silence) if is_kept else 0.0)
    assert liveness.longest(4.9) == 0.0
    liveness.bear(3.0)
    assert (liveness.silence, liveness.actual_silence) == (pytest.approx(-3.0), pytest.approx(4.8))
    liveness.heard()
    assert liveness.longest(1.0) == pytest.approx(4.8), "a silence that was borne was one"


# --- numbers on the wire -----------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, -1.0, 1e-20, 1e20])
def test_the_last_bits_of_a_float32_make_no_difference_and_more_do(scale: float) -> None:
    assert same_float32(scale, scale * (1.0 + 3.9 * 2.0**-24))
    assert same_float32(scale * (1.0 + 3.9 * 2.0**-24), scale)
    assert not same_float32(scale, scale * (1.0 + 4.2 * 2.0**-24))
    assert not same_float32(scale, -scale)


@pytest.mark.parametrize(
    ("a", "b", "same"),
    [
        (math.nan, math.nan, True),
        (math.nan, 0.0, False),
        (math.inf, math.inf, True),
        (math.inf, -math.inf, False),
        (math.inf, 1e38, False),
        (0.0, -0.0, True),
        (0.0, 1e-30, False),
    ],
)
def test_numbers_that_are_none_are_compared_too(a: float, b: float, same: bool) -> None:
    assert same_float32(a, b) is same_float32(b, a) is same


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.5e38, -1e300])
def test_what_no_float32_can_hold_is_not_written(value: float) -> None:
    with pytest.raises(UsageError, match="not a finite 32-bit number"):
        as_float32("P", value)


def test_a_value_is_rounded_as_the_vehicle_will_hold_it() -> None:
    assert as_float32("P", 0.1) == 0.10000000149011612
    assert as_float32("P", 3.0) == 3.0


@pytest.mark.parametrize("name", ["", "A" * 17, "GRÖSSE"])
def test_what_is_no_name_of_a_parameter_is_refused(name: str) -> None:
    assert encoded("A" * 16) == b"A" * 16
    with pytest.raises(UsageError, match="is not a parameter name"):
        encoded(name)


# --- watchdog --------------------------------------------------------------------------------


@pytest.fixture
def watchdog() -> Watchdog:
    return Watchdog(ManualClock())


@pytest.mark.parametrize(("force", "limit"), [("N", 3.0), ("X", 10.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_frozen_attitude_is_a_fault_sooner_while_turning(
    watchdog: Watchdog, force: str, limit: float, sign: float
) -> None:
    watchdog.check_attitude(0.0, (0.1, 0.2))
    watchdog.note_outputs(0.0, {"N": 0.0, "X": 0.0, force: sign * 0.3})
    watchdog.check_attitude(limit, (0.1, 0.2))
    assert watchdog.fault is None
    watchdog.check_attitude(limit + 0.1, (0.1, 0.2))
    with pytest.raises(TelemetryFault, match=f"frozen for {limit + 0.1:.1f} s"):
        watchdog.check()


def test_an_attitude_frozen_before_the_helm_moved_counts_from_then(watchdog: Watchdog) -> None:
    watchdog.check_attitude(0.0, (0.1, 0.2))
    watchdog.note_outputs(50.0, {"N": 0.3})
    watchdog.check_attitude(52.9, (0.1, 0.2))
    assert watchdog.fault is None
    watchdog.check_attitude(53.1, (0.1, 0.2))
    assert watchdog.fault is not None


@pytest.mark.parametrize(
    ("stamp", "used", "words"),
    [
        (100.1, True, ""),
        (104.9, True, ""),
        (105.1, True, "its clock jumped from 100.0 s to 105.1 s"),
        (99.5, False, ""),
        (98.9, True, "its clock jumped back"),
        (1.0, True, "the autopilot has restarted"),
    ],
)
def test_a_stamp_is_used_left_out_or_a_fault(watchdog: Watchdog, stamp: float, used: bool, words: str) -> None:
    assert watchdog.check_stamp(100.0)
    assert watchdog.check_stamp(stamp) is used
    assert (words in str(watchdog.fault)) if words else watchdog.fault is None


# --- files --------------------------------------------------------------------------------


def test_a_bad_line_is_told_with_its_file_its_number_and_what_stands_there(tmp_path: Path) -> None:
    path = tmp_path / "mine.param"
    path.write_text("# saved\nP,0.2\nI,much\n", encoding="utf-8")
    with pytest.raises(BadFile) as caught:
        load_params(path)
    assert str(caught.value) == f"{path}, line 3: 'I' = 'much' is not a parameter and a number"
