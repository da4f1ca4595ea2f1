from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.cli import make_parser
from gcs_autotune.errors import GuardTripped
from gcs_autotune.identify.relay.limit_cycle import find_cycles
from gcs_autotune.manoeuvres import (
    MANOEUVRES,
    Envelope,
    Relay,
    RelaySettings,
    Sequencer,
    limited_orders,
    relay_messages,
)
from gcs_autotune.manoeuvres.relay import WallRelay
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Channel, Mark, Trial

from .toy_craft import Buoyant, PondCraft, answered, at_rest

WALL = {"wall-hysteresis": 0.2, "least-distance": 1.0}
YAW = RelaySettings("psi", "N")
DEPTH = RelaySettings("z", "Z", least_hysteresis=0.15)
WIDE = Envelope(heading_excursion=math.radians(170.0))


def fly(craft, settings, envelope=WIDE, rule=None):
    kept = []
    flown = Sequencer(craft, envelope, SilentObserver(), kept.append).fly(Relay(settings, criterion=rule))
    return flown, kept[0]


class EnoughAfter:
    """A stop rule that has enough after so many reversals."""

    counted_to = math.nan

    def __init__(self, reversals):
        self.reversals, self.begun, self.asked = reversals, 0, []

    def begin(self):
        self.begun += 1

    def update(self, relay, reversals):
        self.asked.append(reversals)
        return "enough is known" if reversals >= self.reversals else ""


def test_a_stop_rule_ends_the_relay_before_five_periods_agree():
    rule = EnoughAfter(3)
    flown, _ = fly(PondCraft(), YAW, rule=rule)
    assert (flown.ending, flown.reason) == ("completed", "enough is known")
    switches = [m for m in flown.marks if m.kind == "switch" and m.detail["x"] != 0.0]
    assert len(switches) == 3
    assert rule.begun == 1
    assert flown.meta["enough"], "so that readers of the record do not require more periods"


def test_the_relay_begins_at_once_if_the_noise_is_known():
    flown, record = fly(PondCraft(), replace(YAW, noise_std=0.05))
    assert record.start == pytest.approx(flown.start, abs=0.11)
    assert flown.meta["x_a"] == pytest.approx(0.25)
    assert flown.meta["noise_std"] == 0.05


def test_the_relay_ends_after_five_agreeing_periods_that_satisfy_condition_7_12():
    flown, _ = fly(PondCraft(), YAW)
    assert flown.ending == "completed"
    (cycle,) = find_cycles(flown, "yaw")
    assert cycle.valid
    assert cycle.periods >= 5
    assert cycle.scatter < 0.10


def test_actual_switching_values_lie_beyond_the_hysteresis_and_are_recorded():
    flown, _ = fly(PondCraft(), YAW)
    switches = [m for m in flown.marks if m.kind == "switch" and "x" in m.detail]
    real = [abs(m.detail["x"]) for m in switches[1:]]
    assert min(real) >= YAW.least_hysteresis
    assert max(real) < 1.5 * YAW.least_hysteresis
    (cycle,) = find_cycles(flown, "yaw")
    assert cycle.x_a_star > cycle.x_a


def test_the_record_includes_the_lead_in_and_the_trial_starts_with_the_relay():
    flown, record = fly(PondCraft(), YAW)
    assert record.start < flown.start
    assert flown.start == pytest.approx(flown.meta["from_t"], abs=0.11)


def test_the_output_grows_until_it_overcomes_a_constant_disturbance():
    flown, _ = fly(PondCraft(bias=0.4), RelaySettings("psi", "N", keep_still=True))
    assert flown.meta["C"] > 0.4
    assert any(m.kind == "grow" for m in flown.marks)
    cycles = find_cycles(flown, "yaw")
    assert cycles[-1].valid
    assert cycles[-1].x_0 > 0.0


def test_a_user_supplied_output_is_kept_and_its_failure_suggests_a_remedy():
    flown, _ = fly(PondCraft(bias=0.4), RelaySettings("psi", "N", output=0.3, keep_still=True))
    assert flown.ending == "aborted"
    assert "--relay-output" in flown.reason or "disturbance" in flown.reason


def test_a_reversed_actuator_is_reported():
    flown, _ = fly(PondCraft(gain=-1.0), YAW)
    assert flown.ending == "aborted"
    assert "reversed" in flown.reason


def test_a_dead_actuator_is_reported():
    flown, _ = fly(PondCraft(gain=0.0), RelaySettings("psi", "N", patience=10.0))
    assert flown.ending == "aborted"
    assert "did not cross the hysteresis" in flown.reason


def test_a_jittery_link_widens_and_slows_the_oscillation():
    class Jittery(PondCraft):
        """Commands take effect a random number of ticks late, as on a loaded radio."""

        rng = np.random.default_rng(2)

        def send(self, command):
            if self.rng.random() < 0.5:
                self.command = command

    flown, _ = fly(Jittery(gain=4.0, drag=4.0), YAW)
    assert any(m.kind == "widen" for m in flown.marks)
    assert flown.ending == "completed"
    assert flown.meta["x_a"] == pytest.approx(1.5 * YAW.least_hysteresis)


def test_noise_widens_the_hysteresis():
    class Noisy(PondCraft):
        rng = np.random.default_rng(1)

        def observe(self):
            seen = super().observe()
            object.__setattr__(seen, "psi", seen.psi + math.radians(4.0) * self.rng.standard_normal())
            return seen

    flown, _ = fly(Noisy(), RelaySettings("psi", "N", tolerance=0.5))
    assert flown.meta["x_a"] > math.radians(13.0)


def test_on_a_boat_the_relay_waits_for_headway():
    craft = PondCraft(firmware="ardurover")
    flown, record = fly(craft, RelaySettings("psi", "N", throttle=0.5))
    assert flown.meta["speed"] == pytest.approx(1.0, rel=0.05)
    assert flown.start - record.start > 3.0


def test_depth_oscillates_about_its_start_value():
    craft = PondCraft()
    craft.z = 4.0
    flown, _ = fly(craft, DEPTH)
    z = flown["z"].values
    assert flown.ending == "completed"
    assert 0.5 * (z.max() + z.min()) == pytest.approx(4.0, abs=0.1)


def test_a_surge_relay_oscillates_the_integrated_speed():
    craft = PondCraft(firmware="ardurover")
    settings = RelaySettings("x", "X", throttle=0.4, reference_speed=0.8, least_hysteresis=0.1)
    flown, _ = fly(craft, settings)
    assert flown.ending == "completed"


def test_an_rov_holds_its_depth_while_its_heading_oscillates():
    craft = PondCraft(bias=0.1)
    craft.z = 4.0
    flown, _ = fly(craft, RelaySettings("psi", "N", keep_still=True))
    assert flown.ending == "completed"
    assert abs(flown["z"].values - 4.0).max() < 0.7


def test_an_oscillation_too_fast_for_the_link_is_widened():
    quick, _ = fly(PondCraft(gain=4.0, drag=4.0), YAW)
    period = find_cycles(quick, "yaw")[-1]
    wanted = 1.5 * (period.T_H + period.T_L)
    settings = RelaySettings("psi", "N", least_period=wanted)
    flown, _ = fly(PondCraft(gain=4.0, drag=4.0), settings)
    assert flown.ending == "completed"
    cycle = find_cycles(flown, "yaw")[-1]
    assert cycle.T_H + cycle.T_L >= wanted
    assert any(m.kind == "widen" for m in flown.marks)


def test_a_craft_faster_than_the_control_ticks_gets_a_wider_hysteresis_not_more_output():
    """Without inertia it is back inside the hysteresis at the next tick; more output makes that worse."""
    lively = PondCraft(gain=400.0, drag=80.0, bias=10.0)
    flown, record = fly(lively, YAW, replace(WIDE, depth_excursion=math.inf))
    assert flown.ending == "aborted"
    assert "control ticks of 0.10 s" in flown.reason
    assert "--control-rate" in flown.reason
    assert [m.kind for m in record.marks].count("widen") == YAW.most_widenings
    assert record.meta["C"] < YAW.most_output


@pytest.mark.parametrize("buoyancy", [-10.0, 3.0, 6.3, 10.0])
def test_a_depth_relay_holds_a_rising_or_sinking_craft_until_it_begins(buoyancy):
    craft = Buoyant(buoyancy, 1.5, 1)
    flown, trial = fly(craft, replace(DEPTH, keep_still=True), Envelope(depth_excursion=10.0))
    assert flown.ending == "completed", flown.reason
    assert abs(trial.meta["reference"] - 1.5) < 1.0
    assert trial["z"].values.min() > 0.2


def test_a_depth_equal_to_the_hysteresis_except_for_rounding_switches_the_relay():
    relay = WallRelay(RelaySettings("d", "X", hysteresis=0.1, noise_std=0.0))
    assert 2.3 - 2.2 < 0.1 < 2.0 - 1.9
    distances = iter((2.3, 2.25, 2.2, 2.25, 2.35, 2.4, 2.4))
    rows = answered(relay, lambda t, _: at_rest(t=t, d=next(distances)), tick=0.1, most=0.6)
    assert [command.X > 0.0 for _, command in rows] == [True, True, False, False, False, True, True]


def test_a_time_based_command_is_not_taken_for_a_saturated_thruster():
    t = np.arange(0.0, 60.0, 0.1)
    for N, limited in ((0.3 * np.sin(t), False), (np.where(t > 1.0, 0.2, 0.0), True)):
        marks = (Mark(0.5, "level", {"N": 0.5}),)
        run = Trial("orders", {"N": Channel("N", "1", t, N)}, marks)
        assert bool(limited_orders(run)) is limited


def options_of(command):
    """The options that *command* takes."""
    verbs = next(action.choices for action in make_parser()._actions if action.dest == "command")
    return set(re.findall(r"--[a-z][a-z-]*", verbs[command].format_help()))


@pytest.mark.parametrize("name", ["relay", "wall-relay"])
def test_advice_from_a_relay_names_existing_options(name):
    settings = MANOEUVRES[name].make(dict.fromkeys(("throttle", "keep-still"), 0.0) | WALL)._settings
    texts = [
        relay_messages.never_settled(settings, 0.3),
        relay_messages.link_too_slow(settings, 0.3),
        relay_messages.overwhelmed(settings, 0.5),
        relay_messages.no_oscillation(settings, 0.5),
        relay_messages.too_fast(settings, 0.5, 4.0, 0.1),
        relay_messages.improper(settings, 0.5),
    ]
    named = re.findall(r"(--[a-z][a-z-]*)(?: \(of `([a-z]+)`\))?", " ".join(texts))
    assert len(named) >= len(texts)
    for option, command in named:
        assert option in options_of(command or "fly"), (option, command)


class GustyBoat(PondCraft):
    """Its bow is pushed about, so that no two periods are alike, and it goes ahead at 2 m/s all the while."""

    def __init__(self):
        super().__init__(firmware="ardurover")
        self.rng = np.random.default_rng(3)

    def _advance(self, dt):
        if self.tick % 7 == 0:
            self.r += 0.05 * self.rng.standard_normal()
        super()._advance(dt)
        self.x += 2.0 * dt


RESTLESS = RelaySettings("psi", "N", output=0.3, hysteresis=math.radians(10.0), most_periods=1000)


def test_an_unsettled_relay_on_a_boat_ends_with_its_record_before_the_distance_limit():
    room = Envelope(heading_excursion=9.0, distance=150.0, cruise=2.0)
    flown, record = fly(GustyBoat(), RESTLESS, room)
    assert flown.ending == "stopped"
    assert re.search(r"not settled after \d+ reversals.*limit 150 m \(--max-distance\)", flown.reason)
    assert 2.0 * record.end == pytest.approx(126.0, abs=1.0), "12 s at 2 m/s are left to turn around"
    assert not flown.meta["enough"], "the record must show that it did not settle"
    assert find_cycles(flown, "yaw")


def test_half_of_a_small_space_may_be_used_at_any_boat_speed():
    room = Envelope(heading_excursion=9.0, distance=60.0, cruise=9.0)
    _, record = fly(GustyBoat(), RESTLESS, room)
    assert 2.0 * record.end == pytest.approx(30.0, abs=1.0), "half of the space may always be used"


def test_a_relay_with_fewer_than_three_reversals_continues_to_the_distance_limit():
    with pytest.raises(GuardTripped, match="distance from start"):
        fly(GustyBoat(), RESTLESS, Envelope(heading_excursion=9.0, distance=14.0))
