"""Commands stamped midway between two messages (decision 3): their constant shift is not reported as an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from towed_boats import yaw_run

from gcs_autotune.diagnose import diagnose
from gcs_autotune.identify.problems import fit_base, plain_form
from gcs_autotune.identify.signals import prepare_as_recorded
from gcs_autotune.trial import Trial

pytestmark = pytest.mark.slow

STEP = 0.1
"""Between two messages [s]; a change stamped midway is half of it too early here, by construction."""

LATE = ("input-delay", "time-offset", "actuator-lag", "measurement-delay")


def dated_midway(trial: Trial) -> Trial:
    """Return *trial* with changes of N stamped half a step before they happen, and saying so."""
    N = trial["N"]
    changed = np.concatenate([[False], np.diff(N.values) != 0.0])
    early = replace(N, t=N.t - np.where(changed, 0.5 * STEP, 0.0))
    return replace(trial, channels={**trial.channels, "N": early}, meta={"outputs_dated": "midway"})


def test_the_base_fit_identifies_the_shift_of_its_stamps() -> None:
    runs = [dated_midway(yaw_run(seed, {})) for seed in (1, 2)]
    form = plain_form(runs)
    _, fitted = fit_base(form, prepare_as_recorded(runs, form)[0])
    std = float(np.sqrt(fitted.covariance()[-1, -1]))
    assert abs(fitted.shift - 0.5 * STEP) < 3.0 * std < 0.2 * STEP


def test_a_misdating_that_the_messages_allow_is_not_an_effect_and_otherwise_a_delay() -> None:
    runs = [dated_midway(yaw_run(seed, {})) for seed in (1, 2)]
    assert diagnose(runs, effects=LATE).verdict == "no-effect"
    result = diagnose([replace(run, meta={}) for run in runs], effects=LATE)
    assert result.verdict == "effect-found" and result.causes[0].effect.slug == "input-delay"


def test_a_delay_beyond_the_messages_is_identified_as_exactly_as_stamps_allow() -> None:
    hidden = {"input-delay@N": {"delay": 0.3}}
    result = diagnose([dated_midway(yaw_run(seed, hidden)) for seed in (1, 2)], effects=LATE)
    delay = result.causes[0].parameters["delay"]
    assert (result.verdict, result.causes[0].effect.slug) == ("effect-found", "input-delay")
    assert abs(delay.value - 0.3) < 2.0 * delay.std
    assert 0.2 * STEP < delay.std < 0.6 * STEP
