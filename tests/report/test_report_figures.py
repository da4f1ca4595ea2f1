"""The curves of the figures, and the size of the figures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import report_stories as stories
from hypothesis import given
from hypothesis import strategies as st

from gcs_autotune.report import tune_document
from gcs_autotune.report.toolkit.document import Figure
from gcs_autotune.report.toolkit.figures import Curve, thin
from gcs_autotune.report.tune.figures import relay_series, step_series
from gcs_autotune.report.tune.story import PLOTTED_SIGNALS
from gcs_autotune.trial import Trial


@given(st.integers(2, 5000), st.integers(0, 2**32 - 1))
def test_thinning_keeps_ends_extremes_and_original_samples(n, seed):
    curve = Curve(np.arange(float(n)), np.random.default_rng(seed).normal(size=n))
    few = thin(curve, 200)
    assert len(few) <= 203
    assert (few.t[0], few.t[-1]) == (curve.t[0], curve.t[-1])
    assert (few.y.min(), few.y.max()) == (curve.y.min(), curve.y.max())
    assert np.all(np.diff(few.t) > 0)
    assert np.array_equal(few.y, curve.y[few.t.astype(int)])


def test_a_step_begins_at_zero_with_its_target():
    series = step_series(stories.step_trial(), PLOTTED_SIGNALS["psi"])
    assert series.size == pytest.approx(math.radians(30.0))
    there, back = series.legs
    for leg in series.legs:
        assert leg.position.t[0] == pytest.approx(-2.0, abs=0.11)
        assert leg.target.t[1] == 0.0
    assert np.allclose(there.target.y, [0.0, series.size, series.size])
    assert np.allclose(back.target.y, [series.size, 0.0, 0.0])


def test_both_legs_of_a_step_are_shown_from_command_to_end_of_comparison():
    whole = step_series(stories.step_trial(), PLOTTED_SIGNALS["psi"])
    cut = step_series(stories.step_trial(), PLOTTED_SIGNALS["psi"], (5.0, 4.0))
    assert [leg.position.t[-1] for leg in cut.legs] == pytest.approx([5.0, 4.0], abs=0.11)
    assert all(leg.position.t[-1] > 20.0 for leg in whole.legs)
    assert [leg.position.y[0] for leg in cut.legs] == pytest.approx([leg.position.y[0] for leg in whole.legs])


def test_a_relay_is_shown_about_its_reference_with_every_switch():
    trial = stories.relay_trial()
    series = relay_series(trial, PLOTTED_SIGNALS["psi"])
    assert abs(float(np.mean(series.position.y))) < math.radians(2.0)
    assert len(series.switches) == len(trial.marks)
    high = np.abs(series.switches.y[1:])
    assert np.all(high > series.hysteresis * 0.99)


def test_the_shaded_part_contains_the_last_five_periods():
    trial = stories.relay_trial()
    series = relay_series(trial, PLOTTED_SIGNALS["psi"])
    assert np.count_nonzero(series.switches.t >= series.last_from) == 11


def along(trial: Trial, dof: str, signal: str, rate: str, force: str) -> Trial:
    """Return a relay on the heading as one on a position."""
    units = {"psi": (signal, "m"), "r": (rate, "m/s"), "N": (force, "1")}
    named = [replace(channel, name=units[n][0], unit=units[n][1]) for n, channel in trial.channels.items()]
    meta = {**trial.meta, "dof": dof, "signal": signal, "force": force}
    return replace(trial, name=f"relay-{dof}", channels={c.name: c for c in named}, meta=meta)


def test_each_relay_of_a_position_tune_is_shown_in_its_own_direction():
    relay = stories.relay_trial()
    relays = along(relay, "surge", "x", "u", "X"), along(relay, "sway", "y", "v", "Y")
    story = replace(stories.kept(), axis="position", fit=None, relays=relays)
    captions = {figure.name: figure.caption for figure in figures_of(story)}
    assert "position ahead relative" in captions["relay-1"]
    assert "position abeam relative" in captions["relay-2"]
    assert "against position ahead" in captions["cycle-x"]
    assert "against position abeam" in captions["cycle-y"]


def figures_of(story) -> list[Figure]:
    return [part for s in tune_document(story).sections for part in s.parts if isinstance(part, Figure)]


def test_figures_come_in_the_order_of_the_report():
    kinds = [figure.name.split("-")[0] for figure in figures_of(stories.kept())]
    assert kinds == ["step", "intervals", "relay", "relay", "cycle", "fit", "fit", "track"]


def test_the_first_step_of_a_dry_run_is_labelled_as_predicted():
    (first, *_) = figures_of(stories.dry_run())
    assert "Predicted" in first.caption and "not measured" in first.caption


def test_the_caption_of_a_relay_states_why_it_ended():
    relay = stories.replace(stories.relay_trial(), reason="the gains are known")
    figures = figures_of(stories.replace(stories.aborted(), relays=(relay,)))
    assert any("End: the gains are known." in figure.caption for figure in figures)


@pytest.mark.slow
def test_a_record_of_an_hour_stays_small():
    relay = stories.relay_trial(duration=1800.0)
    story = stories.replace(stories.aborted(), relays=(relay,) * 8)
    assert sum(figure.name.startswith("relay") for figure in figures_of(story)) == 6
    assert len(stories.page_of(story)) < 1_500_000
