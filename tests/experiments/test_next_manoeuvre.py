"""The proposed manoeuvre is better, uses only the inputs of the runs, and has the predicted effect."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from experiment_plants import BOAT, Steps, circle, recorded, sail

from gcs_autotune.errors import UnknownName, UsageError
from gcs_autotune.experiments import RankedManoeuvre, next_manoeuvre, plan_next, rank_by_precision
from gcs_autotune.experiments.next_manoeuvre import PRESETS
from gcs_autotune.experiments.preview import CONTROL_STEP, Flight, allocation_of, fly
from gcs_autotune.identify import Fit, fit
from gcs_autotune.identify.problems import fitted_model_of
from gcs_autotune.manoeuvres import Manoeuvre, Preset
from gcs_autotune.models import FORMS, CoupledModel, Form
from gcs_autotune.report import plan_plot
from gcs_autotune.trial import Trial

FORM = FORMS["horizontal"].without("Y_0", "Y_vv", "Y_rdot", "X_0", "N_0")
FORM = replace(FORM, start={k: 0.9 * v for k, v in BOAT.items()})


@pytest.fixture(scope="module")
def circled() -> tuple[list[Trial], Fit, RankedManoeuvre]:
    runs = [recorded(circle(wobble=0.02), 60.0, 1, after=10.0)]
    made = fit(runs, FORM, delay=0.0)
    return runs, made, plan_next(made, runs, seconds=40.0)


def test_a_better_manoeuvre_than_another_circle_is_proposed_after_a_circle(
    circled: tuple[list[Trial], Fit, RankedManoeuvre],
) -> None:
    _, _, proposal = circled
    assert "circle" not in proposal.best.candidate.title
    zigzag = next(p for p in proposal.plans if p.candidate.title == "zig-zag 20/20 at 60 % throttle")
    same = next(p for p in proposal.plans if p.candidate.title == "turning circle at 60 % throttle")
    i = [proposal.names.index(n) for n in ("N_r", "N_rr", "N_rdot")]
    assert np.all(zigzag.std[i] < same.std[i])


def test_every_standard_error_falls_and_the_ranking_is_by_the_worst(
    circled: tuple[list[Trial], Fit, RankedManoeuvre],
) -> None:
    _, _, proposal = circled
    for plan in proposal.plans:
        assert np.all(plan.std <= proposal.now.information.std * (1.0 + 1e-9))
        assert plan.gain >= 1.0
    worst = [p.worst for p in proposal.plans]
    assert worst == sorted(worst)
    assert proposal.best.candidate.title in proposal.words[0]
    assert f"from {100 * proposal.now.relative.max():.0f} %" in proposal.words[0]


def test_inputs_stay_within_the_range_of_the_runs(circled: tuple[list[Trial], Fit, RankedManoeuvre]) -> None:
    runs, _, proposal = circled
    X, N = (float(np.abs(runs[0][n].values).max()) for n in "XN")
    assert len(proposal.plans) > 1
    for plan in proposal.plans:
        inputs = plan.flight.inputs
        assert inputs[:, 0].min() >= 0.0  # thrust was never reversed
        assert inputs[:, 0].max() <= X * (1 + 1e-12)
        assert np.abs(inputs[:, 1]).max() <= N * (1 + 1e-12)


def test_a_zigzag_turns_at_its_angle(circled: tuple[list[Trial], Fit, RankedManoeuvre]) -> None:
    _, _, proposal = circled
    plan = next(p for p in proposal.plans if p.candidate.title == "zig-zag 20/20 at 60 % throttle")
    flight = plan.flight
    psi = flight.record.signals["psi"]
    jumps = flight.t[1:][np.diff(np.sign(flight.inputs[:, 1])) != 0.0][1:]
    at = np.abs(np.degrees(np.interp(jumps, psi.t, psi.values)))
    assert len(jumps) >= 4
    assert np.all((at > 19.5) & (at < 26.0))


def test_motion_faster_than_in_the_runs_is_flagged(circled: tuple[list[Trial], Fit, RankedManoeuvre]) -> None:
    _, _, proposal = circled
    straight = next(p for p in proposal.plans if p.candidate.title == "acceleration and coast-down")
    assert any("room" in f for f in straight.flags)
    seen = replace(proposal.now.seen, largest={"u": 0.5, "v": 9.0, "r": 9.0})
    assert any(f.startswith("surge velocity") and "(seen 0.5)" in f for f in straight.reach.beyond(seen, 1.5))
    gentle = next(p for p in proposal.plans if p.candidate.title == "turning circle at 30 % throttle")
    assert gentle.flags == ()
    assert "beyond the runs so far" in proposal.say(straight)


def test_the_predicted_standard_errors_are_achieved() -> None:
    """Fly the proposal in a simulation: the errors of the estimates match the prediction."""
    seen = recorded(circle(wobble=0.02), 60.0, 1, after=10.0)
    form = FORM.fixing({n: BOAT[n] for n in ("X_udot", "Y_vdot", "X_u", "X_uu")})
    model = CoupledModel(form, BOAT)
    made = replace(fit([seen], form, delay=0.0), model=model)
    proposal = plan_next(made, [seen], ["zig-zag-20-20-at-60-throttle"], seconds=30.0)
    flight = proposal.best.flight
    step = flight.t[1] - flight.t[0]

    def allocation(t: float, _: np.ndarray) -> tuple[float, float]:
        X, N = flight.inputs[min(round(t / step), len(flight.t) - 1)]
        return float(X), float(N)

    t, S, _ = sail(BOAT, allocation, 30.0)
    assert np.interp(t, flight.record.signals["psi"].t, flight.record.signals["psi"].values) == pytest.approx(
        S[:, 2], abs=2e-3
    )
    misses, kept = [], []
    for seed in range(4):
        runs = [recorded(circle(wobble=0.02), 60.0, 100 + seed, after=10.0), recorded(allocation, 30.0, 500 + seed)]
        parameters = fit(runs, form, delay=0.0).parameters
        misses.append([parameters[n].value - BOAT[n] for n in proposal.names])
        kept.append([parameters[n].std for n in proposal.names])
    assert np.mean(kept, axis=0) == pytest.approx(proposal.best.std, rel=0.2)
    assert 0.6 < np.sqrt(np.mean(np.square(misses / proposal.best.std))) < 1.4
    sway = proposal.names.index("Y_r")
    assert proposal.best.std[sway] < 0.3 * proposal.now.information.std[sway]


def test_a_manoeuvre_is_proposed_for_a_single_axis() -> None:
    run = recorded(Steps(3), 40.0, 1, signals=("psi",))
    made = fit(run, dof="yaw", structure="linear", delay=0.0)
    proposal = plan_next(made, run, seconds=30.0)
    assert set(proposal.names) == {"alpha_r", "beta_r", "delta"}
    assert {p.candidate.name for p in proposal.plans} >= {"yaw-relay", "steering-doublet", "zig-zag-20-20"}


def test_differential_thrust_steers_and_drives() -> None:
    form = Form(
        "twin", "two thrusters", ("surge", "yaw"), ("X_udot", "N_rdot", "X_u", "N_r"), {},
        {"port": (("X", 1.0), ("N", 0.4)), "starboard": (("X", 1.0), ("N", -0.4))}, coriolis=False,
    )  # fmt: skip
    run = recorded(Steps(1), 10.0, 1)
    record = replace(fitted_model_of(fit(run, dof="yaw", delay=0.0), run).records[0])
    both = replace(record, t_in=np.array([0.0, 1.0]), inputs=np.array([[-5.0, 8.0], [8.0, -5.0]]))
    allocation = allocation_of(form, np.array([-20.0, -2.0, -3.0, -3.0]), [both])
    assert allocation.inputs({"thrust": 1.0}) == pytest.approx([8.0, 8.0])
    assert allocation.inputs({"steer": 1.0}) == pytest.approx([8.0, -8.0])
    assert np.all(np.abs(allocation.inputs({"thrust": 1.0, "steer": 1.0})) <= 8.0)


def test_unknown_manoeuvres_and_invalid_durations_are_rejected(
    circled: tuple[list[Trial], Fit, RankedManoeuvre],
) -> None:
    runs, made, _ = circled
    with pytest.raises(UnknownName, match="zig"):
        plan_next(made, runs, ["zigzag"])
    with pytest.raises(UsageError, match="5 to 3600"):
        plan_next(made, runs, seconds=1.0)
    with pytest.raises(UsageError, match="no candidate"):
        plan_next(made, runs, ["heave-bob"])


def test_bars_show_before_and_after(circled: tuple[list[Trial], Fit, RankedManoeuvre]) -> None:
    _, _, proposal = circled
    axes = plan_plot(proposal).axes[0]
    assert len(axes.patches) == 2 * len(proposal.names)


@pytest.mark.slow
def test_a_coarse_first_ranking_gives_the_same_best_manoeuvres(
    circled: tuple[list[Trial], Fit, RankedManoeuvre], monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, made, _ = circled
    flown: list[float] = []

    def counted(*args: Any, step: float, **named: Any) -> Flight | None:
        flown.append(step)
        return fly(*args, step=step, **named)

    monkeypatch.setattr(next_manoeuvre, "fly", counted)
    required = {"N_r": 1e-3, "N_rdot": 1e-3, "Y_v": 1e-3}
    drawn = [replace(p, make=partial(_for_seconds, p, seconds)) for p in PRESETS.values() for seconds in (20.0, 35.0)]
    found = []
    for finalists in (6, len(drawn)):
        monkeypatch.setattr(next_manoeuvre, "FINALISTS", finalists)
        flown.clear()
        most = {"X": 5.0, "N": 5.0}
        found.append(rank_by_precision(made, runs, required, drawn, longest=60.0, overhead=5.0, most=most))
        assert flown.count(CONTROL_STEP) == (6 if finalists == 6 else len(flown))
    assert len(found[0]) == len(found[1]) > 12
    assert [w.candidate for w in found[0][:6]] == [w.candidate for w in found[1][:6]]
    assert [w.rate for w in found[0][:6]] == [w.rate for w in found[1][:6]]


def _for_seconds(preset: Preset, seconds: float, longest: float) -> Manoeuvre:
    return preset.make(seconds)
