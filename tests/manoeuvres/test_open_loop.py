"""Signals flown by the clock: sweeps with their fades, multisines with low peaks, sequences of full length."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres import MANOEUVRES, Envelope, OpenLoopProgramme, Sequencer
from gcs_autotune.manoeuvres.excitation import prbs
from gcs_autotune.manoeuvres.open_loop import coasting
from gcs_autotune.observer import SilentObserver
from tests.manoeuvres.toy_craft import PondCraft, at_rest

PLAIN = {"steering": 0.5, "side": 1.0, "throttle": 0.0, "keep-still": 0.0}


def flown(name: str, force: str = "N", **options: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and the force commanded, by the clock."""
    kind = MANOEUVRES[name].of(force)
    assert kind.make is not None
    given = {k.replace("_", "-"): v for k, v in options.items()}
    manoeuvre = kind.make({**PLAIN, **given})
    commands, t, out = manoeuvre.commands(at_rest()), 0.0, []
    command = next(commands)
    while manoeuvre.outcome is None:
        assert isinstance(command, Actuate)
        out.append((t, getattr(command, force)))
        t = round(t + 0.05, 9)
        command = commands.send(at_rest(t=t))
    return np.array([row[0] for row in out]), np.array([row[1] for row in out])


def test_a_chirp_rises_over_its_fade_in_and_sweeps_from_one_frequency_to_the_other() -> None:
    t, N = flown("chirp", duration=60.0, f_start=0.1, f_stop=1.0, fade_in=20.0, fade_out=5.0)
    begin = 0.02 * 60.0
    early, middle, late = (np.abs(N[(t > a) & (t < b)]).max() for a, b in ((0, 8), (25, 50), (59, 60)))
    assert early < 0.2 < 0.45 < middle <= 0.5
    assert late < 0.1
    crossings = t[1:][np.diff(np.sign(N)) != 0]
    periods = 2.0 * np.diff(crossings)
    assert periods[1] == pytest.approx(1.0 / 0.12, rel=0.35)
    assert np.median(periods[-8:]) == pytest.approx(1.05, rel=0.1)
    assert not N[t < begin].any()
    with pytest.raises(UsageError, match="exceed --duration 10 s"):
        flown("chirp", duration=10.0, f_start=0.1, f_stop=1.0, fade_in=9.0, fade_out=5.0)


def test_a_multisine_has_its_lines_in_the_band_and_a_low_peak() -> None:
    t, N = flown("multisine", duration=50.0, f_start=0.1, f_stop=0.4)
    late = N[t >= 0.02 * 50.0]
    spectrum = np.abs(np.fft.rfft(late)) ** 2
    f = np.fft.rfftfreq(len(late), 0.05)
    inside = (f > 0.08) & (f < 0.43)
    assert spectrum[inside].sum() > 0.97 * spectrum.sum()
    assert np.abs(N).max() == pytest.approx(0.5, abs=0.01)
    assert np.abs(late).max() / late.std() < 2.0  # a sine has 1.41, sines in phase 5
    with pytest.raises(UsageError, match="no period of a frequency"):
        flown("multisine", duration=5.0, f_start=0.01, f_stop=0.1)


def test_a_prbs_has_the_full_length_of_its_register_and_two_levels() -> None:
    t, N = flown("prbs", duration=127.0, shortest=1.0)
    bits = [math.copysign(1.0, N[np.searchsorted(t, 0.02 * 127.0 + 0.5 + 0.98 * k)]) for k in range(127)]
    assert set(np.round(N[t > 3.0], 9)) == {0.5, -0.5}
    assert sum(bits) == 1.0
    shifted = [np.dot(bits, np.roll(bits, k)) for k in range(1, 127)]
    assert set(shifted) == {-1.0}  # white, as far as two levels can be


@pytest.mark.parametrize("length", [3, 4, 5, 6, 7, 9, 10, 11])
def test_every_register_gives_a_maximum_length_sequence(length: int) -> None:
    """Every state except zero occurs once, so all windows of register length differ (Ljung1999, 13.3)."""
    count = 2**length - 1
    level = prbs({"duration": float(count), "shortest": 1.0})
    bits = [level((k + 0.5) / count) > 0.0 for k in range(count)]
    assert sum(bits) == 2 ** (length - 1)
    assert len({tuple((bits + bits)[k : k + length]) for k in range(count)}) == count


@pytest.mark.parametrize(("duration", "shortest", "bits"), [(8.0, 1.0, 8), (7.5, 1.0, 8), (0.5, 1.0, 1), (4.0, 0.5, 8)])
def test_the_sequence_length_is_the_duration_over_the_shortest_level_rounded_up(
    duration: float, shortest: float, bits: int
) -> None:
    level = prbs({"duration": duration, "shortest": shortest})
    whole = prbs({"duration": 15.0, "shortest": 1.0})
    assert [level((k + 0.5) / bits) for k in range(bits)] == [whole((k + 0.5) / 15.0) for k in range(bits)]


def test_thrust_steps_have_six_distinct_levels_including_zero_and_full() -> None:
    _, X = flown("steps", "X", duration=60.0)
    levels = X[np.flatnonzero(np.diff(X, prepend=9.0))][1:] / 0.5
    assert len(levels) == len(set(levels)) == 6
    assert {0.0, 1.0} <= set(levels)
    assert np.abs(np.diff(levels)).min() > 0.35


def test_a_boat_is_steered_under_thrust_and_not_while_coasting() -> None:
    kind = MANOEUVRES["staircase"].of("X")
    assert kind.make is not None
    commands = kind.make({**PLAIN, "duration": 40.0, "levels": 2.0}).commands(at_rest(psi=0.0))
    command, steered = next(commands), {True: set(), False: set()}
    for i in range(1, 700):
        assert isinstance(command, Actuate)
        if i > 1:  # what follows the first look at the heading
            steered[command.X > 0.0].add(round(command.N, 6))
        command = commands.send(at_rest(t=0.05 * i, psi=-0.2))
    assert steered[False] == {0.0}
    assert len(steered[True]) == 1 and min(steered[True]) > 0.01


def test_a_staircase_is_two_sided_in_yaw_and_ahead_only_in_a_boats_thrust() -> None:
    _, N = flown("staircase", duration=40.0, levels=2)
    assert list(np.round(N[np.flatnonzero(np.diff(N, prepend=9.0))], 9)) == [
        0.0, 0.25, 0.5, 0.25, 0.0, -0.25, -0.5, -0.25, 0.0,
    ]  # fmt: skip
    _, X = flown("staircase", "X", duration=40.0, levels=2)
    assert X.min() == 0.0
    assert X.max() == 0.5


def test_the_output_is_zero_after_the_push() -> None:
    t, Z = flown("free-decay", "Z", duration=30.0, push=5.0)
    assert (Z[(t > 1.0) & (t < 5.0)] == 0.5).all()
    assert not Z[t > 6.0].any()
    with pytest.raises(UsageError, match="is not shorter"):
        flown("free-decay", "Z", duration=5.0, push=5.0)


def test_the_s_manoeuvre_combines_thrust_ahead_and_astern_with_moments_of_both_signs() -> None:
    kind = MANOEUVRES["s-manoeuvre"]
    assert kind.make is not None
    legs = {}
    for still in (0.0, 1.0):
        manoeuvre = kind.make({**PLAIN, "duration": 40.0, "throttle": 0.6, "keep-still": still})
        commands, seen = manoeuvre.commands(at_rest(z=math.nan)), []
        command = next(commands)
        for k in range(1, 400):
            assert isinstance(command, Actuate)
            seen.append((command.X, command.N))
            command = commands.send(at_rest(t=0.1 * k, z=math.nan))
        legs[still] = list(dict.fromkeys(seen))
    assert legs[0.0] == [(0.6, 0.0), (0.6, 0.5), (0.6, -0.5)]
    assert legs[1.0] == [*legs[0.0], (-0.6, 0.5), (-0.6, -0.5)]


def test_each_level_is_shown_and_only_jumps_are_marked() -> None:
    programme = lambda t: {"N": 0.3 if t < 2.0 else (-0.4 if t < 4.0 else -0.4 + 0.09 * (t - 4.0))}  # noqa: E731
    run = OpenLoopProgramme("levels", programme, 8.0)
    commands, phases = run.commands(at_rest()), {}
    next(commands)
    for k in range(1, 17):
        phases[0.5 * k] = run.phase
        commands.send(at_rest(t=0.5 * k))
    assert phases[1.0] == "N +30 %"
    assert phases[3.0] == phases[8.0] == "N -40 %"
    assert [(m.t, m.detail["N"]) for m in run.take_marks()] == [(0.0, 0.3), (2.0, -0.4)]
    assert run.outcome is not None
    assert run.outcome.reason == "flown for 8 s"


def test_each_acceleration_takes_slightly_more_than_half_of_its_time_slot() -> None:
    programme = coasting("stopping", (0.5, 1.0))(20.0)._programme
    assert [programme(t)["X"] for t in (0.0, 5.4, 5.6, 9.9, 10.1, 15.4, 15.6, 19.9)] == [
        *(0.5, 0.5, 0.0, 0.0),
        *(1.0, 1.0, 0.0, 0.0),
    ]


def test_the_end_of_a_level_is_marked_so_that_neutral_is_not_a_shortfall() -> None:
    kind = MANOEUVRES["prbs"].of("N")
    assert kind.make is not None
    manoeuvre = kind.make({**PLAIN, "duration": 20.0, "shortest": 1.0})
    commands, t = manoeuvre.commands(at_rest()), 0.0
    next(commands)
    while manoeuvre.outcome is None:
        t = round(t + 0.05, 9)
        commands.send(at_rest(t=t))
    last = manoeuvre.take_marks()[-1]
    assert (last.t, last.kind, last.detail) == (pytest.approx(20.0, abs=0.06), "level", {"N": 0.0})


def test_a_moored_craft_may_turn_on_its_line() -> None:
    assert all(MANOEUVRES["bollard-staircase"].of(force).turns for force in "NXYZ")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_steps_in_depth_of_a_quick_craft_end_with_their_record_before_the_depth_limit(side: float) -> None:
    steps = MANOEUVRES["steps"].of("Z")
    assert steps.make is not None
    options = {"steering": 0.6, "duration": 60.0, "side": side, "throttle": 0.0, "keep-still": 0.0}
    craft = PondCraft(gain=1.5)
    craft.z = 6.0
    flown = Sequencer(craft, Envelope(), SilentObserver(), lambda trial: None).fly(steps.make(options))
    assert flown.ending == "stopped"
    assert "limit 3.0 m (--max-depth-excursion). The record so far is used" in flown.reason
    assert 0.5 < np.ptp(flown["z"].values) < 3.0
