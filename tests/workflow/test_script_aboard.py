"""The script of ``aboard`` itself, in a Lua interpreter on a simulated boat and ROV: each ending leaves neutral."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from gcs_autotune.firmware import FIRMWARE, read_servo_map
from gcs_autotune.logs import ABOARD_ENDS, ABOARD_ROWS
from gcs_autotune.logs.sample_store import RecordedParameters
from gcs_autotune.manoeuvres import Area, Envelope, RelaySettings, Zone
from gcs_autotune.manoeuvres.aboard import ABOARD_ENDINGS, AboardScript
from sitl import load_vehicle
from sitl.autopilot import Sub
from sitl.vehicle import Vehicle

from .lua_autopilot import LuaHost

NEUTRAL = {"charlie": {0: 1500, 2: 1500}, "blueboat": {0: 1500, 2: 1500}, "falcon": dict.fromkeys(range(5), 1500)}
PATH = "APM/scripts/aboard.lua"


class Pond:
    """A simulated craft with the script loaded, armed in MANUAL, with a ground station that sends neutral sticks."""

    def __init__(self, name: str = "charlie", *, loads: bool = True, **changes: object) -> None:
        self.vehicle = Vehicle(load_vehicle(name), seed=1, parameters={"SCR_ENABLE": 1, "SIM_RC_FAIL": 1})
        self.name = name
        self.autopilot = self.vehicle.autopilot
        self.host = LuaHost(self.vehicle)
        self.is_heard, self.steers = True, True
        firmware = FIRMWARE[f"ardu{self.autopilot.firmware.removeprefix('Ardu').lower()}"]
        self.servos = read_servo_map(RecordedParameters(self.vehicle.parameters.values), firmware)
        boat = firmware.needs_way
        relay = RelaySettings("psi", "N", throttle=0.8 if boat else 0.0, keep_still=not boat)
        script = AboardScript(
            relay=relay,
            servos=self.servos,
            envelope=Envelope(),
            mode=firmware.modes[firmware.manual_mode],
            token=4711,
            go="SCR_USER6",
            path=PATH,
            sticks=(1, 3),
            rows=ABOARD_ROWS.logged,
            ends=ABOARD_ENDS.logged,
            step=math.radians(60.0),
        )
        self.script = replace(script, **changes)  # type: ignore[arg-type]
        self.texts: list[str] = []
        self.run(4.0)
        self.vehicle.card[PATH] = self.script.text.encode()
        self.host.restart()
        self.run(2.0)
        self.autopilot.set_mode(self.script.mode)
        assert self.autopilot.arm(force=True)
        self.run(0.2)

    def tick(self) -> None:
        self.vehicle.move()
        self.autopilot.ms = self.vehicle.ms
        if self.is_heard:
            if self.vehicle.tick % self.vehicle.rate == 0:
                self.autopilot.note_gcs()
            if self.steers and self.vehicle.tick % 5 == 0:
                for channel in range(1, 9):
                    self.autopilot.rc.override(channel, 1500, self.vehicle.ms)
                if isinstance(self.autopilot, Sub):
                    self.autopilot.note_pilot()
        self.vehicle.control()
        self.texts += [text for _, text in self.autopilot.texts]
        self.autopilot.texts.clear()
        assert not self.host.error, self.host.error

    def run(self, seconds: float, until: Callable[[], object] = lambda: False) -> bool:
        end = self.vehicle.seconds + seconds
        while self.vehicle.seconds < end:
            self.tick()
            if until():
                return True
        return False

    def go(self) -> None:
        self.vehicle.parameters.preset("SCR_USER6", 4711)

    @property
    def word(self) -> str:
        """The last word of the script about itself."""
        announced = [text.removeprefix("aboard 4711 ") for text in self.texts if text.startswith("aboard 4711 ")]
        return announced[-1] if announced else ""

    @property
    def is_driven(self) -> bool:
        pwm = self.autopilot.pwm
        return any(abs(pwm[index] - neutral) > 15 for index, neutral in NEUTRAL[self.name].items())

    def until_relay(self) -> None:
        self.go()
        assert self.run(60.0, lambda: self.word == "begin 1")
        assert self.run(30.0, lambda: self.is_driven)


def test_a_loaded_script_removes_its_file_and_waits():
    pond = Pond()
    assert PATH not in pond.vehicle.card
    assert pond.word == "ready"
    pond.run(20.0)
    assert not pond.is_driven
    assert pond.word == "ready"


@pytest.mark.parametrize("name", ["charlie", "blueboat", "falcon"])
def test_two_relays_and_a_step_are_flown_to_the_end(name):
    pond = Pond(name)
    pond.go()
    assert pond.run(600.0, lambda: pond.word in ABOARD_ENDINGS)
    assert pond.word == "done"
    pond.run(0.3)
    assert not pond.is_driven
    ends = [values for _, kind, values in pond.host.rows if kind == "AXE"]
    assert [(part, ending) for part, ending, *_ in ends] == [(3, 0), (5, 0), (7, 0)]
    first, second = ends[0][2], ends[1][2]
    assert second == pytest.approx(2.0 * first) or second == pytest.approx(0.5 * first)


ENDINGS: dict[str, tuple[Callable[[Pond], object], str]] = {
    "a stick": (lambda p: p.host.moved.update({3: 1600}), "stick 3"),
    "another mode": (lambda p: p.autopilot.set_mode(4), "mode changed"),
    "disarming": (lambda p: p.autopilot.disarm(), "disarmed"),
    "the ground station's word": (lambda p: p.vehicle.parameters.preset("SCR_USER6", 0), "stopped"),
    "the fence": (lambda p: setattr(p.host, "breaches", 2), "fence"),
    "an empty battery": (lambda p: setattr(p.host, "charge", 5.0), "battery remaining"),
    "a lost position": (lambda p: setattr(p.host, "has_position", False), "position lost"),
    "a silent ground station": (lambda p: setattr(p, "is_heard", False), ""),
}


@pytest.mark.parametrize("what", ENDINGS)
def test_an_event_ends_the_script_in_neutral(what):
    pond = Pond(silence=1.0)
    pond.until_relay()
    act, word = ENDINGS[what]
    act(pond)
    assert pond.run(4.0, lambda: pond.word.split()[0] != "begin")
    assert pond.word == word if word else pond.word in ("silence", "radio failsafe", "mode changed")
    pond.run(0.1)
    assert not pond.is_driven
    pond.run(20.0)
    assert not pond.is_driven


def test_a_radio_failsafe_ends_the_script_in_neutral():
    pond = Pond(silence=0.0)
    pond.until_relay()
    pond.steers = False
    assert pond.run(10.0, lambda: pond.word in ("radio failsafe", "mode changed"))
    pond.run(0.1)
    assert not pond.is_driven


def test_silence_is_tolerated_when_permitted():
    pond = Pond(silence=0.0)
    pond.until_relay()
    pond.autopilot.last_gcs_ms = -100_000
    assert not pond.run(5.0, lambda: pond.word == "silence")


LIMITS = {
    "time": Envelope(time=8.0),
    "heading excursion": Envelope(heading_excursion=math.radians(8.0)),
    "speed": Envelope(speed=0.8),
    "distance from start": Envelope(distance=5.0),
    "turn rate": Envelope(turn_rate=0.01),
    "roll": Envelope(roll=1e-5),
    "outside the area": Envelope(area=Area((Zone(((0.0, 0.0),), 6.0),), "a circle")),
}


@pytest.mark.parametrize("limit", LIMITS)
def test_a_limit_ends_the_script_in_neutral(limit):
    pond = Pond(envelope=LIMITS[limit])
    pond.go()
    assert pond.run(120.0, lambda: pond.word in ABOARD_ENDINGS)
    assert pond.word == limit
    pond.run(0.1)
    assert not pond.is_driven


def test_the_script_uses_the_area_of_the_envelope():
    star = ((-1.0, -9.0), (9.0, 0.0), (-1.0, 9.0), (2.0, 0.0))
    area = Area((Zone(star), Zone(((6.0, 0.5),), 1.0, inside=False)), "a star with a hole")
    pond = Pond(envelope=Envelope(area=area))
    pond.go()
    assert pond.run(30.0, lambda: pond.word in ABOARD_ENDINGS)
    estimate = pond.autopilot.estimate
    assert (pond.word == "outside the area") == (area.beyond(estimate.x, estimate.y) > 0.0)


def test_a_boat_far_out_turns_towards_its_start():
    pond = Pond(envelope=Envelope(distance=120.0, cruise=1.2))
    pond.go()
    farthest = 0.0

    def ended() -> bool:
        nonlocal farthest
        estimate = pond.autopilot.estimate
        farthest = max(farthest, math.hypot(estimate.x, estimate.y))
        return pond.word in ABOARD_ENDINGS

    assert pond.run(900.0, ended)
    assert pond.word == "done"
    assert 48.0 < farthest < 120.0
    ends = [values for _, kind, values in pond.host.rows if kind == "AXE"]
    assert [(part, ending) for part, ending, *_ in ends] == [(3, 1), (5, 0), (7, 0)]


def test_a_script_that_hangs_leaves_neutral_outputs():
    pond = Pond()
    pond.until_relay()
    pond.host.is_hung = True
    pond.run(0.6)
    assert not pond.is_driven


def test_a_script_that_runs_too_rarely_ends():
    pond = Pond()
    pond.until_relay()
    pond.host.lateness = 300
    assert not pond.run(10.0, lambda: pond.word == "late")
    pond.host.lateness = 700
    assert pond.run(10.0, lambda: pond.word == "late")
    pond.run(0.1)
    assert not pond.is_driven


def test_a_reversed_rudder_ends_the_script():
    pond = Pond()
    reversed_outputs = replace(pond.servos, outputs=tuple(replace(o, sign=-o.sign) if o.channel == 1 else o
                                                          for o in pond.servos.outputs))  # fmt: skip
    pond = Pond(servos=reversed_outputs)
    pond.go()
    assert pond.run(120.0, lambda: pond.word in ABOARD_ENDINGS)
    assert pond.word == "wrong way"
    pond.run(0.1)
    assert not pond.is_driven


def test_a_disarmed_vehicle_is_not_driven():
    pond = Pond()
    pond.autopilot.disarm()
    pond.go()
    pond.run(5.0)
    assert pond.word == "disarmed"
    assert not pond.is_driven


def test_a_script_that_is_not_started_in_time_ends():
    pond = Pond(wait=5.0)
    assert pond.run(10.0, lambda: pond.word == "expired")
    pond.go()
    pond.run(5.0)
    assert not pond.is_driven
