"""What runs do not identify is reported; what they identify raises no doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from experiment_plants import BOAT, Steps, Zigzag, circle, recorded

from gcs_autotune.errors import UnknownName
from gcs_autotune.experiments import identifiability, profile
from gcs_autotune.identify import Fit, fit
from gcs_autotune.models import FORMS, Form
from gcs_autotune.report import correlation_plot, profile_plot
from gcs_autotune.trial import Channel, Trial

FORM = FORMS["horizontal"].without("Y_0", "Y_vv", "Y_rdot", "X_0", "N_0")
FORM = replace(FORM, start={k: 0.9 * v for k, v in BOAT.items()})
SURGE = Form(
    "gain", "surge with unknown thrust", ("surge",), ("X_udot", "X_u", "X_uu", "k_X"), {}, {"X": (("X", "k_X"),)},
    coriolis=False, start={"X_udot": -20.0, "X_u": -4.0, "X_uu": -3.0, "k_X": 1.0},
)  # fmt: skip


@pytest.fixture(scope="module")
def round_and_round() -> tuple[list[Trial], Fit]:
    runs = [recorded(circle(wobble=0.02), 80.0, 1, after=30.0)]
    return runs, fit(runs, FORM, delay=0.0)


def test_a_circle_reports_correlated_pairs_and_suggests_a_zigzag(
    round_and_round: tuple[list[Trial], Fit],
) -> None:
    runs, made = round_and_round
    found = identifiability(made, runs)
    pairs = [set(d.members[:2]) for d in found.directions]
    assert {"Y_v", "Y_r"} in pairs
    assert {"X_u", "X_uu"} in pairs
    sway = next(d for d in found.doubts if "Y_r and Y_v" in d.cause)
    assert sway.slug == "cannot-tell"
    assert "in this circle" in sway.cause and "zig-zag" in sway.cure


def test_the_reported_ambiguous_change_is_within_the_noise(round_and_round: tuple[list[Trial], Fit]) -> None:
    runs, made = round_and_round
    found = identifiability(made, runs)
    assert found.directions
    for direction in found.directions:
        step = np.zeros(len(found.names))
        for name in direction.members:
            i = found.names.index(name)
            size = max(abs(found.information.values[i]), found.scales.size[i])
            if abs(found.information.values[i]) >= 0.5 * found.scales.size[i]:
                size = found.information.values[i]
            step[i] = direction.changes[name] * size
        # the least of the other parameters' following makes the rest of the 1.96 noise levels
        F = found.information.matrix
        rest = [i for i in range(len(step)) if step[i] == 0.0]
        follow = -np.linalg.solve(F[np.ix_(rest, rest)], F[rest] @ step)
        step[rest] = follow
        assert 0.3 < np.sqrt(step @ F @ step) <= 1.97


def test_random_steps_leave_no_doubt() -> None:
    runs = [recorded(Steps(1), 40.0, 1), recorded(Steps(2), 40.0, 2)]
    found = identifiability(fit(runs, FORM, delay=0.0), runs)
    assert found.doubts == ()
    assert np.all(found.relative < 0.1)


def test_a_zigzag_resolves_the_ambiguity_of_a_circle(round_and_round: tuple[list[Trial], Fit]) -> None:
    runs, made = round_and_round
    before = identifiability(made, runs).information.bounds
    more = [*runs, recorded(Zigzag(), 60.0, 2)]
    after = identifiability(fit(more, FORM, delay=0.0), more)
    for name in ("Y_v", "Y_r", "N_v"):
        assert after.information.bounds[name] < 0.1 * before[name]
    assert not any({"Y_v", "Y_r"} <= set(d.members) for d in after.directions)


def test_an_unknown_thrust_scale_is_an_exact_ambiguity() -> None:
    run = recorded(Steps(1), 40.0, 1)
    found = identifiability(fit(run, SURGE, delay=0.0), run)
    (scale,) = (d for d in found.directions if d.exact)
    assert scale.scaling and set(scale.members) == {"X_udot", "X_u", "X_uu", "k_X"}
    assert all(np.isinf(s) for s in found.information.std)
    assert "by a common factor" in found.doubts[0].cause
    assert "bollard pull" in found.doubts[0].cure


def test_a_known_mass_resolves_the_thrust_scale() -> None:
    run = recorded(Steps(1), 40.0, 1)
    found = identifiability(fit(run, SURGE.fixing({"X_udot": -25.0}), delay=0.0), run)
    assert not found.directions
    assert np.all(found.relative < 0.2)


def test_sway_drag_is_reported_as_poorly_identifiable_with_little_sway() -> None:
    runs = [recorded(Zigzag(N=1.0, angle=3.0), 40.0, 3)]
    form = replace(FORM.freeing("Y_vv"), start={**FORM.start, "Y_vv": -5.0})
    found = identifiability(fit(runs, form, delay=0.0), runs)
    (own,) = (d for d in found.doubts if "Y_vv" in d.cause and "poorly identifiable" in d.cause)
    assert "sway stays below 0." in own.cause


def test_an_unexcited_term_is_reported_with_an_infinite_bound() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    u = np.interp(t, t, np.sin(0.3 * t)) + np.random.default_rng(0).normal(0.0, 0.01, len(t))
    X = 25.0 * 0.3 * np.cos(0.3 * t) + 6.0 * np.sin(0.3 * t)
    channels = {"u": Channel("u", "m/s", t, u), "X": Channel("X", "N", t, X)}
    form = Form("s", "s", ("surge",), ("X_udot", "X_u", "k_L"), {}, {"X": (("X", 1.0),), "L": (("X", "k_L"),)},
                coriolis=False, start={"X_udot": -20.0, "X_u": -5.0, "k_L": 1.0})  # fmt: skip
    channels["L"] = Channel("L", "N", t, np.zeros(len(t)))
    run = Trial("no L", channels)
    found = identifiability(fit(run, form, delay=0.0), run)
    assert np.isinf(found.information.bounds["k_L"])
    assert any("k_L is not identifiable" in d.cause for d in found.doubts)


def test_the_profile_of_an_identifiable_parameter_is_closed_and_covers_the_truth() -> None:
    runs = [recorded(Steps(1), 30.0, 5)]
    made = fit(runs, FORM, delay=0.0)
    for name in ("N_v", "X_udot"):
        found = profile(made, runs, name)
        assert found.closed
        assert found.low < BOAT[name] < found.high
        p = made.parameters[name]
        assert found.high - found.low == pytest.approx(2.0 * 1.96 * p.std, rel=0.15)


def test_a_profile_along_an_exact_ambiguity_stays_open() -> None:
    run = recorded(Steps(1), 20.0, 1)
    found = profile(fit(run, SURGE, delay=0.0), run, "k_X")
    assert found.high == np.inf
    assert 0.0 <= found.low < 0.1  # any factor, but no other sign
    assert "no bound upwards" in found.words
    with pytest.raises(UnknownName):
        profile(fit(run, SURGE, delay=0.0), run, "k_Y")


def test_figures_show_every_parameter(round_and_round: tuple[list[Trial], Fit]) -> None:
    runs, made = round_and_round
    figure = correlation_plot(identifiability(made, runs))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == list(FORM.free)
    run = recorded(Steps(1), 20.0, 1)
    curves = profile_plot([profile(fit(run, SURGE.fixing({"X_udot": -25.0}), delay=0.0), run, "X_uu")])
    assert curves.axes[0].get_xlabel().startswith("X_uu")
