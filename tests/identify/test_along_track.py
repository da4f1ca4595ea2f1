"""A current or head wind is identified by flying out and back at the same throttle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.identify.thrust.surge import along_track, doubt_of
from gcs_autotune.trial import Channel, Mark, Trial

LEVELS = (0.4, 0.54, 0.4)
NORTH, SOUTH = 0.1, 0.1 - math.pi


def run(heading: float, water: float, noise: float = 0.01, seed: int = 1) -> Trial:
    """Steady at each level; a current of *water* [m/s] sets towards north."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.1)
    psi = Channel("psi", "rad", t, heading + rng.normal(0.0, 0.02, len(t)))
    u = [3.0 * level + water * math.cos(heading) + float(rng.normal(0.0, noise)) for level in LEVELS]
    marks = tuple(
        Mark(10.0 * (k + 1), "steady", {"u": v, "X": level, "level": level})
        for k, (v, level) in enumerate(zip(u, LEVELS, strict=True))
    )
    return Trial("run", {"psi": psi}, marks)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("water", [0.2, -0.3])
def test_a_current_is_identified_with_its_speed_and_direction(water: float, seed: int) -> None:
    trials = [run(NORTH, water, seed=seed), run(SOUTH, water, seed=seed + 10)]
    found = along_track(trials)
    assert found is not None
    assert found.set == pytest.approx(water, abs=0.03)
    assert found.matters
    doubt = doubt_of(found)
    assert "from 186 deg" in doubt.cause if water > 0.0 else "from 006 deg" in doubt.cause
    assert f"{abs(found.set):.2f} m/s" in doubt.cause


@pytest.mark.parametrize("seed", range(8))
def test_slack_water_raises_no_doubt(seed: int) -> None:
    found = along_track([run(NORTH, 0.0, 0.02, seed), run(SOUTH, 0.0, 0.02, seed + 10)])
    assert found is not None
    assert not found.matters


def test_runs_in_one_direction_do_not_show_a_current() -> None:
    assert along_track([run(NORTH, 0.3), run(NORTH + 0.5, 0.3)]) is None
    assert along_track([run(NORTH, 0.3)]) is None
