"""From the wire to the fit: uneven stamps, outputs dated by the autopilot's loops, late turn rates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.axis import signals
from gcs_autotune.identify.signals import prepare
from gcs_autotune.link import MemoryLink, Session, open_craft
from gcs_autotune.manoeuvres import Envelope, Relay, RelaySettings, Sequencer
from gcs_autotune.observer import SilentObserver
from gcs_autotune.trial import Channel, Trial

pytestmark = pytest.mark.slow

LAG, RATE = 0.6, 0.8
"""The boat: time constant [s] and turn rate at full helm [rad/s]; inertia is LAG / RATE, drag 1 / RATE."""
NOISE = 0.002
WANTED = {"ATTITUDE": 40.0, "SERVO_OUTPUT_RAW": 40.0, "RC_CHANNELS": 10.0}
WIDE = Envelope(heading_excursion=math.radians(170.0))


class Hull(ScriptedVehicle):
    """A boat with inertia, a noisy compass, and a gyro that is late by ``rate_lag`` [whole ticks]."""

    def __init__(self, late_ticks: int = 0, seed: int = 7) -> None:
        super().__init__()
        self.turn_rate, self.lag = RATE, LAG
        self.rates = [0.0] * (late_ticks + 1)
        self.track: list[tuple[float, float]] = []
        rng = np.random.default_rng(seed)

        def edit(message: Any) -> Any:
            if message.get_type() == "ATTITUDE":
                message.yaw += float(rng.normal(0.0, NOISE))
                message.yawspeed = self.rates[0] + float(rng.normal(0.0, NOISE))
            return message

        self.edit = edit

    def _turn(self, steady: float) -> None:
        super()._turn(steady)
        self.rates = [*self.rates[1:], self.r]
        self.track.append((self.time, self.psi))


def fly_relay(hull: Hull, output: float = 0.4) -> Trial:
    craft = open_craft(Session(MemoryLink(hull)), wanted_rates=WANTED)
    craft.arm()
    relay = Relay(RelaySettings("psi", "N", output=output, hysteresis=math.radians(10.0)), "relay")
    return Sequencer(craft, WIDE, SilentObserver(), lambda trial: None).fly(relay)


@pytest.fixture(scope="module")
def trial() -> Trial:
    return fly_relay(Hull())


@pytest.fixture(scope="module")
def relays() -> list[Trial]:
    """One relay per seed. Some changes of output fall between messages 40 ms apart, others 20."""
    return [fly_relay(Hull(seed=seed)) for seed in range(1, 10)]


def with_rate(trial: Trial, change: Callable[[Channel], Channel]) -> Trial:
    return replace(trial, channels={**trial.channels, "r": change(trial["r"])})


def late(rate: Channel) -> Channel:
    return replace(rate, t=rate.t + 0.02)


def filtered(rate: Channel) -> Channel:
    values, share = rate.values.copy(), 0.025 / (0.025 + 0.06)
    for i in range(1, len(values)):
        values[i] = values[i - 1] + share * (rate.values[i] - values[i - 1])
    return replace(rate, values=values)


def scaled(rate: Channel) -> Channel:
    return replace(rate, values=1.05 * rate.values)


def biased(rate: Channel) -> Channel:
    return replace(rate, values=rate.values + 0.01)


def as_if_uniform(trial: Trial) -> Trial:
    def even(c: Channel) -> Channel:
        return replace(c, t=np.linspace(c.t[0], c.t[0] + (len(c) - 1) / 40.0, len(c)))

    return replace(trial, channels={n: even(c) for n, c in trial.channels.items()})


def test_40_hz_from_a_50_hz_loop_arrive_in_gaps_of_20_and_40_ms(trial: Trial) -> None:
    for name in ("psi", "N"):
        gaps = np.round(np.diff(np.unique(trial[name].t)), 3)
        assert set(gaps[gaps > 0.005]) <= {0.01, 0.02, 0.03, 0.04}
        assert len(set(gaps)) > 1


def test_the_fit_is_correct_because_every_sample_has_its_own_stamp(trial: Trial) -> None:
    inertia = fit_axis([trial], dof="yaw", structure="linear").parameters["alpha_r"]
    assert inertia.value == pytest.approx(LAG / RATE, abs=3.0 * inertia.std)
    assert inertia.std < 0.02 * inertia.value


def test_every_heading_matches_its_own_stamp_and_would_not_match_even_ones() -> None:
    hull = Hull()
    trial = fly_relay(hull)

    def error(run: Trial) -> float:
        true = np.interp(run["psi"].t, *np.array(hull.track).T)
        return float(np.std(run["psi"].values - true))

    assert error(trial) == pytest.approx(NOISE, rel=0.1)
    assert error(as_if_uniform(trial)) > 1.15 * NOISE


def test_a_change_of_output_is_dated_within_one_loop(trial: Trial) -> None:
    """Messages 20 ms apart on a 20 ms loop leave no doubt; 40 ms apart they leave one loop's."""
    assert prepare(trial, "yaw")[0].dating <= 0.01 + 1e-9
    assert prepare(replace(trial, meta={**trial.meta, "loop_period": 0.0}), "yaw")[0].dating > 0.015


def test_a_good_gyro_joins_every_fit_and_the_standard_error_of_the_inertia_is_correct(relays: list[Trial]) -> None:
    fits = [fit_axis([run], dof="yaw", structure="linear") for run in relays]
    assert [fit.extra["signals"] for fit in fits] == [["psi", "r"]] * len(relays)
    off = [(f.parameters["alpha_r"].value - LAG / RATE) / f.parameters["alpha_r"].std for f in fits]
    assert max(f.parameters["alpha_r"].std for f in fits) < 0.001 * LAG / RATE
    assert math.sqrt(sum(z**2 for z in off) / len(off)) < 1.8


def test_a_good_gyro_joins_a_heading_that_is_noisy_or_coarse(relays: list[Trial]) -> None:
    """Such a heading dates no change of output and contains little information; the gyro does both."""
    rng = np.random.default_rng(3)
    assert len(relays) >= 4
    for run in relays[:4]:
        psi = run["psi"]
        noisy = replace(psi, values=psi.values + rng.normal(0.0, 0.02, len(psi)))
        coarse = replace(psi, values=np.radians(np.round(np.degrees(psi.values))))
        for heading in (noisy, coarse):
            fit = fit_axis([replace(run, channels={**run.channels, "psi": heading})], dof="yaw", structure="linear")
            assert fit.extra["signals"] == ["psi", "r"]
            inertia = fit.parameters["alpha_r"]
            assert inertia.value == pytest.approx(LAG / RATE, abs=3.5 * inertia.std)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [(late, "lags by"), (filtered, "lags by"), (scaled, "scale differs by +"), (biased, "biased by 0.0")],
)
def test_a_late_filtered_scaled_or_biased_gyro_is_excluded_from_every_fit(
    wrong: Callable[[Channel], Channel], why: str, relays: list[Trial]
) -> None:
    assert len(relays) >= 4
    for run in relays:
        fit = fit_axis([with_rate(run, wrong)], dof="yaw", structure="linear")
        assert fit.extra["signals"] == ["psi"]
        assert why in fit.extra["signals_left_out"]["r"]


def test_changes_of_output_between_messages_are_dated_by_the_motion(
    relays: list[Trial],
) -> None:
    """With their original dates they colour the residuals and raise standard errors two- to fourfold."""
    doubtful = 0
    for run in relays:
        record = prepare(run, "yaw")[0]
        doubtful += int(np.count_nonzero(record.slack))
        fit = fit_axis([run], dof="yaw", structure="linear", use=("position",))
        assert fit.extra["std_inflation"] == pytest.approx(1.0)
        assert fit.parameters["alpha_r"].value == pytest.approx(LAG / RATE, abs=3.0 * fit.parameters["alpha_r"].std)
    assert doubtful > len(relays)


def test_a_late_gyro_is_corrected_and_joins_the_fit() -> None:
    hull = Hull(late_ticks=3, seed=1)
    hull.parameters["INS_GYRO_FILTER"] = math.sqrt(2.0) / (2.0 * math.pi * 0.06)
    known = fly_relay(hull)
    assert known.meta["rate_lag"] == pytest.approx(0.06)
    assert known["psi"].t[-1] - known["r"].t[-1] == pytest.approx(0.06)
    fit = fit_axis([known], dof="yaw", structure="linear")
    assert fit.to_dict()["signals"] == ["psi", "r"]
    assert fit.parameters["alpha_r"].value == pytest.approx(LAG / RATE, rel=0.01)


def test_a_gyro_of_unknown_lag_is_excluded_from_the_fit_and_reported() -> None:
    fit = fit_axis([fly_relay(Hull(late_ticks=3))], dof="yaw", structure="linear")
    assert fit.to_dict()["signals"] == ["psi"]
    assert "lags by" in fit.to_dict()["signals_left_out"]["r"]


def test_a_fit_without_a_covariance_still_checks_the_gyro(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "_raised_covariance", lambda solution: np.full_like(solution.whole, np.nan))
    assert "r" in fit_axis(trial).extra["signals"]
    turned = with_rate(trial, lambda rate: replace(rate, values=1.3 * rate.values))
    assert "its scale differs" in fit_axis(turned).extra["signals_left_out"]["r"]


def test_a_diverging_motion_is_not_compared(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    compared = signals._compared
    monkeypatch.setattr(
        signals, "_compared", lambda *a: replace(compared(*a), nu=np.full_like(compared(*a).nu, np.nan))
    )
    assert "diverges" in fit_axis(trial).extra["signals_left_out"]["r"]
