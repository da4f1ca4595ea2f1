"""The horizon of coupled output error: a course-unstable craft is identified although whole runs diverge."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_autotune.errors import UsageError
from gcs_autotune.identify import fit
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

TRUTH = {"N_r": 0.15, "N_rr": -2.0, "N_delta": 0.3}
"""Per unit of inertia: without rudder it turns by itself, at 0.075 rad/s to either side."""

RUDDER = {"delta": (("N", "N_delta"),)}
FORM = Form("unstable", "", ("yaw",), tuple(TRUTH), {"I_z": 1.0}, RUDDER, coriolis=False, normalised=True)


def zig_zag(seed: int, seconds: float = 120.0) -> Trial:
    rng = np.random.default_rng(seed)
    psi, r, delta, rows = 0.0, 0.0, 0.1, []
    for k in range(round(seconds * 10)):
        delta = -0.1 if psi > 0.15 else 0.1 if psi < -0.15 else delta
        rows.append((0.1 * k, psi, r, delta))
        for _ in range(20):
            push = TRUTH["N_r"] * r + TRUTH["N_rr"] * abs(r) * r + TRUTH["N_delta"] * delta + 0.02 * rng.normal()
            psi, r = psi + 0.005 * r, r + 0.005 * push
    t, heading, rate, rudder = np.array(rows).T
    return Trial(
        f"zig-zag {seed}",
        {
            "psi": Channel("psi", "rad", t, heading + rng.normal(0.0, 0.002, len(t))),
            "r": Channel("r", "rad/s", t, rate + rng.normal(0.0, 0.002, len(t))),
            "delta": Channel("delta", "rad", t, rudder),
        },
    )


def test_an_unstable_craft_with_process_noise_is_identified_over_a_horizon() -> None:
    found = fit([zig_zag(1), zig_zag(2)], FORM, delay=0.0, horizon=15.0)
    for name, truth in TRUTH.items():
        assert found.parameters[name].value == pytest.approx(truth, rel=0.25), name
    assert found.parameters["N_r"].value > 0.0


def test_pieces_are_no_longer_than_the_horizon_and_lose_no_sample() -> None:
    (record,) = prepare_form(zig_zag(3), FORM)
    pieces = record.within(20.0)
    assert len(pieces) == 6
    assert all(p.stamps[-1] - p.start <= 20.0 for p in pieces)
    assert sum(len(p.signals["psi"].t) for p in pieces) == len(record.signals["psi"].t)
    assert len(record.within(np.inf)) == 1


def test_an_invalid_horizon_is_rejected() -> None:
    with pytest.raises(UsageError, match="horizon"):
        fit(zig_zag(1), FORM, delay=0.0, horizon=-3.0)
