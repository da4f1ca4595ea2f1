"""Wrong units found from numbers alone: each factor, both ways, and what is not a wrong unit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.identify.signals import check_axes
from gcs_autotune.identify.signals.intake import check_units
from gcs_autotune.trial import Channel, Trial

Array = NDArray[np.float64]
T = np.arange(0.0, 30.0, 0.1)
UNITS = {
    "N": "1",
    "delta": "rad",
    "psi": "rad",
    "r": "rad/s",
    "z": "m",
    "w": "m/s",
    "x": "m",
    "y": "m",
    "u": "m/s",
    "v": "m/s",
    "U": "m/s",
}


def run(t: Array = T, **columns: Array) -> Trial:
    return Trial("own", {n: Channel(n, UNITS[n], t, v) for n, v in columns.items()})


def doubts_of(trial: Trial) -> list[str]:
    return [f"{d.slug}: {d.cause}" for d in check_units(trial)]


RATE = 0.3 * np.cos(0.5 * T) + 0.1
ANGLE = 0.6 * np.sin(0.5 * T) + 0.1 * T


def test_correct_units_raise_no_doubt() -> None:
    assert doubts_of(run(psi=ANGLE, r=RATE, z=ANGLE, w=RATE)) == []
    assert doubts_of(run(psi=ANGLE)) == doubts_of(run(r=RATE)) == []


@pytest.mark.parametrize(("factor", "unit"), [(180.0 / math.pi, "degrees"), (2.0 * math.pi, "revolutions")])
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("off", [1.0, 1.07, 0.93])
def test_an_angle_and_its_rate_that_differ_by_a_unit_are_rejected(
    factor: float, unit: str, way: int, off: float
) -> None:
    with pytest.raises(BadFile, match=f"The factor of {unit} is {factor:.3g}, so one of the columns is in {unit}"):
        check_units(run(psi=ANGLE * off * factor**way, r=RATE))
    (text,) = doubts_of(run(psi=ANGLE * 1.09 * 2.0, r=RATE))
    assert "psi turns 2.18 times as much as r integrates to" in text and "factor of" not in text


@pytest.mark.parametrize(("factor", "unit"), [(3.6, "km/h"), (1.0 / 0.3048, "feet"), (3600.0 / 1852.0, "knots")])
@pytest.mark.parametrize("way", [1, -1])
def test_small_factors_of_lengths_are_doubted(factor: float, unit: str, way: int) -> None:
    (text,) = doubts_of(run(z=ANGLE * factor**way, w=RATE))
    assert text.startswith("contradiction: z changes") and f"one of the columns is in {unit}" in text
    (text,) = doubts_of(run(z=ANGLE * 2.5**way, w=RATE))
    assert f"{2.5**way:.3g} times" in text and "factor of" not in text


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mm"), (100.0, "cm")])
def test_large_factors_of_lengths_are_rejected(factor: float, unit: str) -> None:
    with pytest.raises(BadFile, match=f"is in {unit} and its header states another unit\\. Correct"):
        check_units(run(z=ANGLE * factor, w=RATE))
    with pytest.raises(BadFile, match=f"is in {unit}"):
        check_units(run(z=-ANGLE * factor, w=RATE))


@pytest.mark.parametrize("share", [-1.0, -0.7, -2.0])
def test_opposite_signs_are_doubted(share: float) -> None:
    (text,) = doubts_of(run(z=share * ANGLE, w=RATE))
    assert "opposite signs" in text and f"{share:.3g} times" in text


def test_too_few_samples_are_not_judged_and_a_constant_column_is_not_a_wrong_unit() -> None:
    wrong = ANGLE * 100.0
    with pytest.raises(BadFile):
        check_units(run(T[:40], z=wrong[:40], w=RATE[:40]))
    assert doubts_of(run(T[:19], z=wrong[:19], w=RATE[:19])) == []
    (text,) = doubts_of(run(z=wrong, w=0.0 * RATE))
    assert "w stands still while z changes" in text


def test_samples_that_are_not_numbers_and_gaps_are_skipped() -> None:
    holed = np.where(np.arange(len(T)) % 7 == 0, np.nan, ANGLE * 100.0)
    with pytest.raises(BadFile, match="is in cm"):
        check_units(run(z=holed, w=RATE))
    keep = (T < 12.0) | (T > 20.0)
    jumped = np.where(T > 15.0, ANGLE + 50.0, ANGLE)
    assert doubts_of(run(T[keep], z=jumped[keep], w=RATE[keep])) == []


def test_samples_further_apart_than_the_window_are_compared_over_four_intervals() -> None:
    t = np.arange(0.0, 120.0, 1.5)
    slow, rate = 20.0 * np.sin(0.1 * t), 2.0 * np.cos(0.1 * t)
    assert doubts_of(run(t, z=slow, w=rate)) == []
    with pytest.raises(BadFile, match="is in cm"):
        check_units(run(t, z=slow * 100.0, w=rate))


TRACK: Mapping[str, Array] = {"x": 3.0 * np.sin(0.4 * T), "y": 3.0 * np.cos(0.4 * T)}
SPEED = np.full(len(T), 1.2)


def test_a_track_is_compared_with_the_speed_over_ground_or_both_components() -> None:
    chord = 2.0 * 3.0 * np.sin(0.2) / 1.2  # over a window of 1 s the chord stands for the arc
    assert 0.98 < chord < 1.0
    assert doubts_of(run(**TRACK, U=SPEED)) == doubts_of(run(**TRACK, u=0.8 * SPEED, v=0.6 * SPEED)) == []
    for speed in ({"U": SPEED / 3.6}, {"u": 0.8 * SPEED / 3.6, "v": 0.6 * SPEED / 3.6}):
        (text,) = doubts_of(run(**TRACK, **speed))
        assert (
            text.startswith("contradiction: x, y") and "km/h" in text and ("as U integrates" in text) is ("U" in speed)
        )
    assert doubts_of(run(**TRACK, u=SPEED / 3.6)) == [], "a part alone may be any share of it"
    assert doubts_of(run(x=TRACK["x"], U=SPEED / 3.6)) == []


def sawtooth(height: float, turns: float = 4.0) -> Array:
    return np.mod(np.linspace(0.0, turns * height, len(T)), height) - 0.5 * height


@pytest.mark.parametrize(
    ("height", "words"),
    [
        (360.0, "Its header states radians, but the numbers are degrees"),
        (2.0 * math.pi / (180.0 / math.pi), "Its header states degrees, but the numbers are radians"),
    ],
)
def test_the_wrap_of_a_heading_shows_its_unit(height: float, words: str) -> None:
    for off in (1.0, 1.009):
        with pytest.raises(BadFile, match=f"wraps round at .* rad\\. {words}"):
            check_units(run(psi=sawtooth(height * off)))
    assert doubts_of(run(psi=sawtooth(2.0 * math.pi))) == []
    assert doubts_of(run(T[:19], psi=sawtooth(height)[:19])) == []


@pytest.mark.parametrize(("rate", "is_doubted"), [(3.4, False), (3.6, True), (-3.6, True)])
def test_a_heading_that_turns_faster_than_any_craft_is_doubted(rate: float, is_doubted: bool) -> None:
    found = doubts_of(run(psi=rate * T))
    assert len(found) == is_doubted
    assert not found or ("turns faster than 3.5 rad/s" in found[0] and "(3.6 rad/s)" in found[0])


@pytest.mark.parametrize(("largest", "is_refused"), [(0.6, False), (3.4, False), (3.6, True), (-35.0, True)])
def test_a_rudder_beyond_half_a_turn_is_in_degrees(largest: float, is_refused: bool) -> None:
    rudder = np.where(T < 15.0, largest, math.nan)
    if not is_refused:
        assert doubts_of(run(psi=ANGLE, delta=rudder)) == []
        return
    with pytest.raises(BadFile, match=r"more than half a turn of the rudder\..* write delta\[deg\] in the header"):
        check_units(run(psi=ANGLE, delta=rudder))


@pytest.mark.parametrize(("largest", "is_doubted"), [(1.0, False), (1.4, False), (-1.6, True), (500.0, True)])
def test_a_normalised_output_far_beyond_one_is_doubted(largest: float, is_doubted: bool) -> None:
    found = doubts_of(run(psi=ANGLE, N=largest * np.sign(RATE)))
    assert len(found) == is_doubted
    assert not found or f"reaches {abs(largest):.3g} without a unit. Without a unit, 1 means full output" in found[0]


def cruise(swing: float, course: float = 0.0, current: float = 0.0, noise: float = 0.0) -> dict[str, Array]:
    """Return a run that oscillates about its course: speeds of the craft, and of the track over ground."""
    t = np.arange(0.0, 120.0, 0.1)
    psi = course + swing * np.sin(0.1 * t)
    u, v = 1.5 + 0.2 * np.sin(0.3 * t), -0.3 * np.cos(0.1 * t)
    north = u * np.cos(psi) - v * np.sin(psi) + current
    east = u * np.sin(psi) + v * np.cos(psi)
    x, y = (0.1 * np.cumsum(speed) + noise * np.random.default_rng(1).normal(size=len(t)) for speed in (north, east))
    return {"t": t, "x": x, "y": y, "psi": psi, "u": u, "v": v, "north": north, "east": east}


@pytest.mark.parametrize("course", [0.0, 1.6, -2.5])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_track_rates_labelled_as_body_speeds_are_rejected(course: float, noise: float) -> None:
    own = cruise(0.4, course, noise=noise)
    seen = {n: own[n] for n in ("x", "y", "psi")}
    check_axes(run(own["t"], **seen, u=own["u"], v=own["v"]))
    with pytest.raises(BadFile, match="u and v of run 'own' are the rates of x and y, not the speeds ahead"):
        check_axes(run(own["t"], **seen, u=own["north"], v=own["east"]))


def test_currents_straight_runs_and_missing_columns_do_not_raise_a_frame_error() -> None:
    drifts = cruise(0.4, current=1.0)
    check_axes(run(drifts["t"], **{n: drifts[n] for n in ("x", "y", "psi", "u", "v")}))
    straight = cruise(0.1, 1.6)
    over_ground = {"u": straight["north"], "v": straight["east"]}
    check_axes(run(straight["t"], **{n: straight[n] for n in ("x", "y", "psi")}, **over_ground))
    turning = cruise(0.4)
    check_axes(run(turning["t"], **{n: turning[n] for n in ("x", "y")}, u=turning["north"], v=turning["east"]))


def test_degrees_too_fast_to_unwrap_are_reported_as_degrees() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    rate = 0.8 * np.sin(0.4 * t) + 0.4 * np.sin(1.3 * t)
    psi = np.degrees(np.cumsum(0.1 * rate))
    run = Trial("own", {"psi": Channel("psi", "rad", t, psi), "r": Channel("r", "rad/s", t, rate)})
    try:
        text = " ".join(d.cure for d in check_units(run))
    except BadFile as error:
        text = str(error)
    assert "degrees" in text and "revolutions" not in text
