"""The thrust at each throttle level of a boat, relative to its inertia."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.thrust import level_forces
from gcs_autotune.trial import Channel, Mark, Trial

LEVELS = (1.0, -0.5, 0.5, -1.0, 0.25, -0.25, 0.1, 0.0, 0.6, 0.0)
EACH = 6.0


def thrust(p: float, astern: float) -> float:
    return (0.4 * abs(p) + 0.6 * p * p) * (1.0 if p > 0.0 else -astern)


def run(seed: int = 0, astern: float = 0.6, lag: float = 0.3, noise: float = 0.02, current: float = 0.0) -> Trial:
    """A boat of 1 kg with drag 0.3 u + 0.2 u|u|, whose speed over ground includes a *current*."""
    dt, u = 0.02, 0.0
    t = np.arange(0.0, EACH * len(LEVELS), dt)
    output, speed = np.zeros(len(t)), np.zeros(len(t))
    for k, now in enumerate(t):
        target = LEVELS[min(int(now / EACH), len(LEVELS) - 1)]
        last = output[k - 1] if k else 0.0
        output[k] = last + np.clip(target - last, -dt, dt)  # 100 % per second
        late = output[max(k - round(lag / dt), 0)]
        u += dt * (thrust(float(late), astern) - 0.3 * u - 0.2 * u * abs(u))
        speed[k] = u + current
    marks = tuple(Mark(EACH * k, "level", {"X": level}) for k, level in enumerate(LEVELS))
    u_at = slice(None, None, 5)
    measured = speed[u_at] + np.random.default_rng(seed).normal(0.0, noise, len(speed[u_at]))
    channels = {"u": Channel("u", "m/s", t[u_at], measured), "X": Channel("X", "1", t[::2], output[::2])}
    return Trial("levels", channels, marks, "completed")


@pytest.mark.parametrize(("current", "most"), [(0.0, 0.05), (0.3, 0.2), (-0.3, 0.2)])
def test_thrust_is_identified_at_each_level_with_its_uncertainty(current: float, most: float) -> None:
    apart = []
    for seed in range(10):
        found = level_forces(run(seed, current=current))
        true = np.array([thrust(c, 0.6) for c in found.commands])
        assert found.forces == pytest.approx(true, abs=most)
        apart.append((found.forces - true) / found.stds)
    assert found.lag == pytest.approx(0.3, abs=0.11)
    assert 0.3 < float(np.sqrt(np.mean(np.square(apart)))) < 3.0


def test_a_run_with_too_few_levels_is_rejected() -> None:
    whole = run()
    short = Trial("levels", whole.channels, whole.marks[:3], "completed")
    with pytest.raises(NotInformative, match="do not show the thrust curve"):
        level_forces(short)
