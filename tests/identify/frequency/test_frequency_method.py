"""The method ``frequency`` through the interface of the package."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from axis_plants import Relay

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify import AxisFit, fit_axis
from gcs_autotune.identify.frequency import FrequencyResponse
from gcs_autotune.trial import Channel, Trial, load_trial

Record = Callable[..., Trial]
DATA = Path(__file__).parents[3] / ".." / "shared" / "data"


def sweep(low: float, high: float, duration: float, amplitude: float = 0.3) -> Callable[[float, float], float]:
    return lambda t, eta: amplitude * float(np.sin(low * t + (high - low) * t * t / (2.0 * duration)))


def slugs(fit: AxisFit) -> set[str]:
    return {d.slug for d in fit.doubts}


@pytest.mark.parametrize(("command", "source"), [(sweep(0.05, 3.0, 120.0), "spectrum"), (Relay(0.3, 0.2), "harmonics")])
def test_inertia_drag_and_force_are_identified_together_with_the_response(
    command: Callable[[float, float], float], source: str, record: Record
) -> None:
    run = record((0.36, 0.12, 0.0, 0.01), command, 120.0, noise=0.002)
    fit = fit_axis(run, method="frequency")
    assert (fit.model.alpha, fit.model.beta) == pytest.approx((0.36, 0.12), rel=0.02)
    assert fit.model.delta == pytest.approx(0.01, abs=0.003)
    assert fit.model.beta_quadratic == 0.0
    assert fit.extra["response"]["source"] == source
    assert fit.extra["preferred_order"] == 1
    nomoto = fit.extra["nomoto"]
    assert nomoto["model"]["K"] == pytest.approx(1.0 / 0.12, rel=0.02)
    assert nomoto["std"]["K"] / nomoto["model"]["K"] == pytest.approx(fit.parameters["beta_r"].std / 0.12, rel=0.05)
    assert fit.fit_percent > 95.0
    assert len(FrequencyResponse.from_dict(json.loads(fit.to_json())["response"])) >= 3
    assert "model-misfit" not in slugs(fit)


@pytest.mark.slow
def test_a_delay_is_identified_and_a_known_one_kept(record: Record) -> None:
    run = record((0.36, 0.12, 0.0, 0.0), sweep(0.05, 3.0, 120.0), 120.0, delay=0.3, noise=0.002)
    found = fit_axis(run, method="frequency")
    assert found.model.delay == pytest.approx(0.3, abs=0.01)
    assert found.parameters["delay"].status == "fitted"
    kept = fit_axis(run, method="frequency", delay=0.3)
    assert kept.model.delay == 0.3
    assert kept.parameters["delay"].status == "fixed"


@pytest.mark.slow
def test_a_band_that_misses_the_corner_frequency_is_reported(record: Record) -> None:
    plant = (0.36, 0.12, 0.0, 0.0)
    fast = fit_axis(record(plant, sweep(2.0, 6.0, 60.0, 1.0), 60.0, noise=0.002), method="frequency")
    (doubt,) = [d for d in fast.doubts if d.slug == "narrow-band"]
    assert "rad/s is lower" in doubt.cause
    assert fast.model.alpha == pytest.approx(0.36, rel=0.05)
    agile = (0.036, 0.12, 0.0, 0.0)
    slow = fit_axis(record(agile, sweep(0.05, 1.0, 120.0), 120.0, noise=0.002), method="frequency")
    (doubt,) = [d for d in slow.doubts if d.slug == "narrow-band"]
    assert "rad/s is higher" in doubt.cause
    assert slow.model.beta == pytest.approx(0.12, rel=0.03)


def test_motion_not_caused_by_the_input_is_reported(record: Record) -> None:
    run = record((0.36, 0.12, 0.0, 0.0), sweep(0.05, 3.0, 120.0, 0.01), 120.0, noise=0.05)
    assert "low-coherence" in slugs(fit_axis(run, method="frequency"))


def test_quadratic_drag_at_two_amplitudes_is_reported_as_a_misfit(record: Record) -> None:
    runs = [record((0.03, 0.0, 0.07, 0.0), Relay(C, 0.26), 60.0, name=f"C {C}") for C in (0.03, 0.17)]
    fit = fit_axis(runs, method="frequency")
    assert "model-misfit" in slugs(fit)
    assert "output-error" in next(d.cure for d in fit.doubts if d.slug == "model-misfit")


def test_options_that_the_method_does_not_support_are_rejected(record: Record) -> None:
    run = record((0.36, 0.12, 0.0, 0.0), sweep(0.05, 3.0, 60.0), 60.0)
    with pytest.raises(UsageError, match="linear damping only"):
        fit_axis(run, method="frequency", structure="nonlinear")
    with pytest.raises(UsageError, match="source 'welch'"):
        fit_axis(run, method="frequency", source="welch")
    with pytest.raises(UsageError, match="tapers"):
        fit_axis(run, method="frequency", tapers=1)
    with pytest.raises(NotInformative, match="relay"):
        fit_axis(run, method="frequency", source="harmonics")


def measured(folder: str, name: str) -> Path:
    path = DATA / folder / name
    if not path.exists():
        pytest.skip(f"{folder}/{name} is not beside the repository (../shared/data)")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "K", "T"),
    [("Z_10_01", (-0.45, -0.2), (10, 30)), ("Z_20_05", (-0.3, -0.12), (7, 20)), ("Z_30_05", (-0.2, -0.1), (5, 15))],
)
def test_a_measured_tanker_in_a_zig_zag_has_a_plausible_gain_and_time_constant(
    name: str, K: tuple[float, float], T: tuple[float, float]
) -> None:
    """KVLCC2 model, 7 m: gain falls with rudder angle because drag grows; sway makes a second order of it."""
    fit = fit_axis(load_trial(measured("kvlcc2_hsva", f"{name}.csv")), dof="yaw", method="frequency")
    model = fit.extra["nomoto"]["model"]
    assert K[0] < model["K"] < K[1]
    assert T[0] < model["T"] < T[1]
    assert fit.fit_percent > 75.0
    assert fit.extra["preferred_order"] == 2
    second = fit.extra["nomoto_2"]["model"]
    assert second["T_1"] > second["T_3"] > second["T_2"] > 0.0


def test_a_boat_in_the_autopilots_simulator_shows_its_gain_and_its_link_delay() -> None:
    """Its truth: r = 1.18 V s with V = 6.8 m/s, no inertia; about 55 ms from stick to heading; stick .1 gives .148."""
    path = measured("ardupilot_sitl", "rover_relay_C0.1_h5.csv")
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    t, heading, stick, servo = (
        np.array([float(row[k]) for row in rows]) for k in ("t_sim", "heading_deg", "cmd", "servo1")
    )
    per_stick = float(np.median(np.abs(servo - 1500.0))) / 500.0 / float(np.median(np.abs(stick)))
    channels = {
        "psi": Channel("psi", "rad", t, np.radians(heading)),
        "N": Channel("N", "1", t, per_stick * stick),
    }
    fit = fit_axis(Trial("boat", channels), dof="yaw", method="frequency")
    model = fit.extra["nomoto"]["model"]
    assert model["K"] == pytest.approx(1.18 * 6.8, rel=0.08)
    assert 0.02 < model["T"] + model["delay"] < 0.08
