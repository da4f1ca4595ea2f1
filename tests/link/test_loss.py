"""A lossy link is detected by the gaps in the vehicle's sequence numbers."""

from __future__ import annotations

import random

import pytest
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import LinkError, NoReply
from gcs_autotune.link import MemoryLink, Parameters, Session, open_craft
from gcs_autotune.link.liveness import Loss
from gcs_autotune.workflow.connection import telemetry_rates


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.3, 0.6, 0.9])
def test_the_loss_rate_is_read_from_the_sequence_numbers(loss: float) -> None:
    rng, counted = random.Random(3), Loss()
    for k in range(5000):
        if rng.random() >= loss:
            counted.hear(k % 256)
    assert counted.share == pytest.approx(loss, abs=0.03)
    assert (f"loses {100.0 * counted.share:.0f} %" in counted.words) == (loss > 0.1)


def test_restarts_and_reordered_frames_are_not_counted_as_loss() -> None:
    counted = Loss()
    for sequence in (*range(200), 0, *range(1, 100), 98, 99, 100, 101):
        counted.hear(sequence)
    assert counted.lost < 60
    assert Loss().words == ""


def refusal_over(loss: float, seed: int) -> str:
    """Return why a link that loses that share is refused; empty where it is not."""
    link = MemoryLink(ScriptedVehicle(), loss=loss, seed=seed)
    with Session(link, heartbeat_timeout=60.0) as session:
        try:
            session.discover(60.0)
            open_craft(session, wanted_rates=telemetry_rates(10.0))
        except LinkError as error:
            return str(error)
    return ""


@pytest.mark.parametrize(("loss", "least"), [(0.3, 15), (0.9, 60)])
def test_a_lossy_link_is_refused_as_lossy_and_not_as_slow_or_old(loss: float, least: int) -> None:
    refusals = [refusal for seed in range(6) if (refusal := refusal_over(loss, seed))]
    shares = [int(refusal.partition("loses ")[2].split(" ")[0]) for refusal in refusals if "loses" in refusal]
    assert 3 <= len(refusals) == len(shares)
    assert all(least <= share <= 99 for share in shares)
    assert not any("too slow" in refusal or "older" in refusal for refusal in refusals)


def test_a_parameter_lost_nine_times_in_ten_is_not_reported_missing() -> None:
    refused = 0
    for seed in range(4):
        link = MemoryLink(ScriptedVehicle(), loss=0.9, seed=seed)
        with Session(link, heartbeat_timeout=60.0) as session:
            session.discover(60.0)
            session.pause(20.0)
            try:
                Parameters(session).read_all(["SERVO1_FUNCTION", "SERVO3_FUNCTION", "CRUISE_SPEED", "WP_SPEED"])
            except NoReply as error:
                refused += 1
                assert "loses" in str(error) or "no longer answers" in str(error)
    assert refused
