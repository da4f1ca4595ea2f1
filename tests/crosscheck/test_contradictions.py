"""Contradictory sensors are reported, clean records are not; the records are the benchmark's own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.contradictory_sensors import (
    CLEAN,
    EVERY,
    SPOILT,
    Conditions,
    clean_trial,
    is_named,
    record,
    spoilt_trial,
    trial_of,
)
from gcs_autotune.crosscheck import contradictions
from gcs_autotune.trial import Channel, Trial

SEED = 7


@pytest.mark.parametrize("k", range(len(SPOILT)), ids=[case[0] for case in SPOILT])
def test_a_spoilt_column_is_reported(k: int) -> None:
    found = contradictions(spoilt_trial(SEED, k))
    assert is_named(found, k), [(c.pair, c.kind, c.value) for c in found]


@pytest.mark.parametrize("k", range(len(CLEAN)), ids=[case[0] for case in CLEAN])
def test_a_clean_record_has_no_contradiction(k: int) -> None:
    assert contradictions(clean_trial(SEED, k)) == ()


def test_a_column_that_is_not_used_is_not_compared() -> None:
    k = [case[0] for case in SPOILT].index("r x 0.5")
    run = spoilt_trial(SEED, k)
    assert contradictions(run) and contradictions(run, use=["psi"]) == ()
    assert contradictions(run, use=["psi", "r"])


def test_the_track_shows_whether_heading_or_rate_is_wrong() -> None:
    names = [case[0] for case in SPOILT]
    for name, suspect in (("psi x 0.4", "psi"), ("r x 0.5", "r"), ("r turned round", "r")):
        found = contradictions(spoilt_trial(SEED, names.index(name)))
        assert found[0].suspect == suspect, name


def test_no_column_is_suspected_without_a_track() -> None:
    k = [case[0] for case in SPOILT].index("psi x 0.4")
    run = spoilt_trial(SEED, k)
    alone = Trial("alone", {n: run[n] for n in ("psi", "r", "N")})
    (found,) = contradictions(alone)
    assert found.suspect == "" and "Nothing else in the run shows which" in found.cause


@pytest.mark.parametrize(("factor", "unit"), [(180.0 / math.pi, "degrees"), (2.0 * math.pi, "revolutions")])
def test_the_factor_of_a_unit_is_recognised(factor: float, unit: str) -> None:
    run = spoilt_trial(SEED, [case[0] for case in SPOILT].index("r x 0.5"))
    rate = Channel("r", "rad/s", run["r"].t, 2.0 * factor * run["r"].values)
    (found,) = contradictions(Trial("own", {"psi": run["psi"], "r": rate}))
    assert found.unit == unit


def test_a_craft_that_moves_astern_on_purpose_is_not_a_contradiction() -> None:
    conditions = Conditions()
    astern = record(np.random.default_rng(3), "astern", conditions, 60.0)
    assert contradictions(trial_of(astern, EVERY, conditions, "astern")) == ()
    result = trial_of(astern, ("psi", "r", "x", "y", "u", "v", "N"), conditions, "astern, by its own speed")
    assert contradictions(result) == ()
    silent = trial_of(astern, ("psi", "r", "x", "y", "N"), conditions, "astern, untold")
    (found,) = contradictions(silent)
    assert "If it went that way on purpose" in found.cure


def test_the_yaw_rate_of_a_pitched_craft_is_not_a_contradiction() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    theta, rate = np.full(len(t), math.radians(40.0)), 0.4 * np.sin(0.5 * t)
    psi = np.cumsum(rate * 0.1)
    own = rate * math.cos(math.radians(40.0))
    columns = {"psi": psi, "r": own, "q": 0.0 * t, "phi": 0.0 * t, "theta": theta}
    units = {"psi": "rad", "r": "rad/s", "q": "rad/s", "phi": "rad", "theta": "rad"}
    assert contradictions(Trial("pitched", {n: Channel(n, units[n], t, v) for n, v in columns.items()})) == ()
    level = {n: Channel(n, units[n], t, v) for n, v in columns.items() if n in ("psi", "r")}
    assert contradictions(Trial("level", level))[0].value == pytest.approx(1.0 / math.cos(math.radians(40.0)), rel=0.03)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_craft_that_heels_in_turns_has_a_pitch_rate_without_pitching(stuck: bool) -> None:
    t, rng = np.arange(0.0, 120.0, 0.1), np.random.default_rng(5)
    phi, rate = 0.3 * np.sin(0.4 * t), 0.8 * np.sin(0.4 * t)  # it heels to the outside, like the tugboat
    pitching = 0.2 * np.sin(1.1 * t) if stuck else 0.0 * t
    columns = {
        "phi": phi,
        "theta": 0.0 * t,
        "q": pitching * np.cos(phi) + rate * np.sin(phi),
        "r": rate * np.cos(phi) - pitching * np.sin(phi),
    }
    units = {"phi": "rad", "theta": "rad", "q": "rad/s", "r": "rad/s"}
    channels = {n: Channel(n, units[n], t, v + rng.normal(0.0, 0.004, len(t))) for n, v in columns.items()}
    assert [c.suspect for c in contradictions(Trial("heeled", channels))] == ["theta"] * stuck


def _turning(seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps [s], heading [rad] and rate [rad/s] of a craft that turns to and fro."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 120.0, 0.1)
    rate = 0.5 * np.sin(0.4 * t) + 0.3 * np.sin(1.1 * t)
    heading = np.cumsum(0.1 * rate) + rng.normal(0.0, 0.004, len(t))
    return t, heading, rate + rng.normal(0.0, 0.004, len(t))


def _run(t: np.ndarray, psi: np.ndarray, r: np.ndarray) -> Trial:
    return Trial("own", {"psi": Channel("psi", "rad", t, psi), "r": Channel("r", "rad/s", t, r)})


@pytest.mark.parametrize("column", ["psi", "r"])
@pytest.mark.parametrize(("start", "end"), [(40.0, 80.0), (60.0, 120.0), (0.0, 30.0)])
@pytest.mark.parametrize("noisy", [False, True], ids=["frozen", "noisy"])
def test_a_column_stuck_for_part_of_the_run_is_reported_with_that_part(
    column: str, start: float, end: float, noisy: bool
) -> None:
    t, psi, r = _turning()
    values = {"psi": psi, "r": r}
    part = (t >= start) & (t < end)
    stuck = np.full(int(part.sum()), values[column][int(np.flatnonzero(part)[0])])
    values[column][part] = stuck + (np.random.default_rng(2).normal(0.0, 0.004, len(stuck)) if noisy else 0.0)
    (found,) = contradictions(_run(t, values["psi"], values["r"]))
    assert found.suspect == column and f"{column} stands still from" in found.cause
    named = [float(word) for word in found.cause.split("from ")[1].split(" s ")[0].split(" to ")]
    assert named == pytest.approx([start, end], abs=6.0)


def test_a_heading_of_noise_with_a_real_rate_is_reported() -> None:
    t, psi, r = _turning()
    noise = np.random.default_rng(3).normal(0.0, 1.0, len(t))
    (found,) = contradictions(_run(t, noise, r))
    assert "change, but independently of each other" in found.cause
    assert contradictions(_run(t, psi, r)) == ()


def test_a_factor_clearly_different_from_a_unit_is_not_reported_as_a_unit() -> None:
    t, psi, r = _turning()
    (found,) = contradictions(_run(t, psi / 60.0, r))
    assert found.unit == "per minute"
    depth = np.cumsum(0.1 * 0.4 * np.sin(0.3 * t))
    channels = {"z": Channel("z", "m", t, 2.0 * depth), "w": Channel("w", "m/s", t, 0.4 * np.sin(0.3 * t))}
    (found,) = contradictions(Trial("dive", channels))
    assert found.unit == "" and found.value == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(("factor", "named"), [(1.13, ""), (1.0 / 3.2808, "feet")])
def test_a_depth_scaled_by_an_estimator_is_accepted_and_one_in_feet_reported(factor: float, named: str) -> None:
    t = np.arange(0.0, 30.0, 0.05)
    depth, w = -0.2 * np.cos(2.3 * t), 0.2 * 2.3 * np.sin(2.3 * t)
    found = contradictions(Trial("dive", {"z": Channel("z", "m", t, factor * depth), "w": Channel("w", "m/s", t, w)}))
    assert [c.unit for c in found] == ([named] if named else [])


@pytest.mark.parametrize("exchanged", [False, True])
def test_a_craft_that_slides_in_turns_is_not_mistaken_for_exchanged_axes(exchanged: bool) -> None:
    t = np.arange(0.0, 120.0, 0.2)
    slides, circles = math.radians(25.0) * np.sin(0.1 * t), 0.1 * t
    psi = circles if exchanged else math.radians(45.0) + slides
    course = math.radians(90.0) - psi  # both tracks fit the headings once x and y are exchanged
    columns = {
        "psi": ("rad", psi),
        "x": ("m", np.cumsum(np.cos(course)) * 0.2),
        "y": ("m", np.cumsum(np.sin(course)) * 0.2),
    }
    found = contradictions(Trial("run", {n: Channel(n, unit, t, values) for n, (unit, values) in columns.items()}))
    assert ("exchanged" in {c.kind for c in found}) is exchanged
