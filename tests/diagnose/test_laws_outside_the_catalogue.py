"""A cause is confident only if laws outside the catalogue fit no better: cubic drag, ringing, held-out runs."""

from __future__ import annotations

from collections.abc import MutableMapping

import numpy as np
import pytest
from open_loop_runs import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.adequacy import nonparametric_rivals
from gcs_autotune.diagnose.resonance_check import resonance_checks
from gcs_autotune.effects import EFFECTS, EffectInstance
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from sitl.effects import EffectParameter, HiddenEffect, Setting
from sitl.plants import Wrench

pytestmark = pytest.mark.slow


class CubicDrag(HiddenEffect):
    """Drag with the cube of the yaw rate."""

    slug = "cube-of-the-rate"
    meaning = "test only"
    parameters = (EffectParameter("coefficient", "N m s^3"),)

    def begin(self, setting: Setting) -> None:
        self.state = setting.state

    def alter_force(self, t: float, wrench: Wrench) -> None:
        wrench.N -= self["coefficient"] * self.state.r**3


class Ringing(HiddenEffect):
    """An actuator on a spring: its output follows its command as a mass oscillates behind its hook."""

    slug = "spring-behind-the-command"
    meaning = "test only"
    parameters = (EffectParameter("frequency", "rad/s"), EffectParameter("damping", "1"))

    def begin(self, setting: Setting) -> None:
        self.at = self.rate = 0.0

    def alter_input(self, t: float, dt: float, inputs: MutableMapping[str, float]) -> None:
        omega, zeta, result = self["frequency"], self["damping"], inputs["N"]
        steps = max(1, int(np.ceil(omega * dt / 0.05)))
        for _ in range(steps):
            self.rate += dt / steps * (omega**2 * (result - self.at) - 2.0 * zeta * omega * self.rate)
            self.at += dt / steps * self.rate
        inputs["N"] = self.at


def fitted(runs, slug, values):
    """The runs with one effect fitted to them, right or wrong."""
    form = plain_form(runs, None)
    problem, base = fit_base(form, prepare_as_recorded(runs, form)[0])
    entry, place = EFFECTS[slug], "yaw"
    own = EffectInstance(slug, place, values, entry.constants(place, problem.data_summary))
    found = problem.fit(base.theta, (own,), base.initial, shift=base.shift)
    assert found is not None
    return problem, found


def test_quadratic_drag_is_distinguished_from_cubic_drag():
    begin = {"coefficient": 1.0}
    assert not nonparametric_rivals(
        *fitted(towed(("quadratic-drag", "yaw", {"coefficient": 1.5})), "quadratic-drag", begin)
    )
    assert nonparametric_rivals(*fitted(towed(CubicDrag(coefficient=2.0)), "quadratic-drag", begin))


def test_waves_are_distinguished_from_ringing_after_every_command():
    begin = {"amplitude": 0.1, "frequency": 1.9, "bandwidth": 0.05}
    wave = ("wave-disturbance", "yaw", {"amplitude": 0.15, "frequency": 1.9, "bandwidth": 0.05})
    (_, likely), *none = resonance_checks(*fitted(towed(wave), "wave-disturbance", begin))
    assert not none and likely > 0.05
    (_, likely), *none = resonance_checks(
        *fitted(towed(Ringing(frequency=1.9, damping=0.04)), "wave-disturbance", begin)
    )
    assert not none and likely < 1e-6


def test_ringing_that_a_wave_model_can_follow_is_only_partly_explained():
    result = diagnose(towed(Ringing(frequency=1.9, damping=0.08)), effects=("wave-disturbance",))
    assert [c.effect.slug for c in result.causes] == ["wave-disturbance"]
    assert result.verdict == "partly-explained"


def test_a_cause_visible_only_in_the_held_out_runs_is_found_from_all_runs():
    hidden = ("saturation", "N", {"limit": 0.55})
    small, large = towed(hidden, full=0.5, seed=2), towed(hidden, seed=3)
    requested = ("saturation", "rate-limit", "quadratic-actuator", "quadratic-drag")
    assert diagnose(small, effects=requested).verdict == "no-effect"
    result = diagnose(small, unseen=large, effects=requested)
    assert [c.effect.slug for c in result.causes] == ["saturation"]
    assert result.causes[0].parameters["limit"].value == pytest.approx(0.55, abs=0.02)
    assert "validation-was-needed" in [d.slug for d in result.doubts]


def test_readings_rounded_far_beyond_their_noise_leave_no_heavy_tails():
    rounded = ("quantisation", "psi", {"step": 0.035})
    biased = ("input-bias", "yaw", {"bias": 0.1})
    requested = ("quantisation", "input-bias", "tether-pull", "wind-moment", "outliers")
    result = diagnose(towed(rounded, biased, noise=0.004), effects=requested)
    assert result.verdict == "effect-found"
    assert {c.effect.slug for c in result.causes} == {"quantisation", "input-bias"}
