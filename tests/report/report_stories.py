"""Stories to render: small simulated records, and results filled in by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design import Change, Margins, Prediction, Proposal, StepMetrics
from gcs_autotune.identify import (
    AxisFit,
    Decision,
    Doubt,
    Fit,
    IsoEstimate,
    LimitCycle,
    Parameter,
    StructureFit,
    Trace,
)
from gcs_autotune.models import SingleDof
from gcs_autotune.report import TuneStory, to_html, tune_document
from gcs_autotune.trial import Channel, Mark, Trial

MODEL = SingleDof("yaw", "1", alpha=0.1795, beta=0.052, beta_quadratic=0.4076, delta=0.01, delay=0.2)
DT = 0.1
STEP = math.radians(30.0)
HYSTERESIS = math.radians(10.0)


def _rate(model: SingleDof, r: float, tau: float) -> float:
    drag = (model.beta + model.beta_quadratic * abs(r)) * r
    for _ in range(10):
        r += DT / 10.0 * (tau + model.delta - drag) / model.alpha
        drag = (model.beta + model.beta_quadratic * abs(r)) * r
    return r


def _trial(name, columns, marks, meta, ending="completed"):
    units = {"psi": "rad", "r": "rad/s", "N": "1"}
    t = np.array(columns.pop("t"))
    channels = {n: Channel(n, units[n], t, np.array(v)) for n, v in columns.items()}
    return Trial(name, channels, tuple(marks), ending, "as planned", meta)


def relay_trial(name="relay-1", output=0.3, hysteresis=HYSTERESIS, duration=90.0, seed=3):
    rng = np.random.default_rng(seed)
    psi, r, high, marks = 1.2, 0.0, True, [Mark(5.0, "switch", {"x": 0.0, "N": output})]
    columns = {"t": [], "psi": [], "r": [], "N": []}
    pending = [output] * 2
    for i in range(int(duration / DT)):
        t, seen = 5.0 + i * DT, psi - 1.2 + rng.normal(0.0, 0.004)
        wanted = False if seen > hysteresis else True if seen < -hysteresis else high
        if wanted != high:
            high = wanted
            marks.append(Mark(t, "switch", {"x": seen, "N": output if high else -output}))
        pending.append(output if high else -output)
        for key, value in zip(columns, (t, seen + 1.2, r + rng.normal(0.0, 0.004), pending[-1]), strict=True):
            columns[key].append(value)
        r = _rate(MODEL, r, pending.pop(0))
        psi += r * DT
    meta = {"manoeuvre": "relay", "signal": "psi", "force": "N", "C": output, "x_a": hysteresis, "reference": 1.2}
    return _trial(name, columns, marks, meta)


def step_trial(name="step-before", p=0.5, d=0.1, seed=5, duration=30.0):
    rng = np.random.default_rng(seed)
    base = 0.7
    psi, r, columns = base, 0.0, {"t": [], "psi": [], "r": [], "N": []}
    marks = [
        Mark(100.0, "target", {"value": base, "phase": "hold"}),
        Mark(104.0, "target", {"value": base + STEP, "phase": "step"}),
        Mark(104.0 + duration, "target", {"value": base, "phase": "back"}),
    ]
    pending = [0.0, 0.0]
    for i in range(int((4.0 + 2.0 * duration) / DT)):
        t = 100.0 + i * DT
        target = [m.detail["value"] for m in marks if m.t <= t + 1e-9][-1]
        seen = psi + rng.normal(0.0, 0.004)
        pending.append(float(np.clip(p * (target - seen) - d * r, -1.0, 1.0)))
        for key, value in zip(columns, (t, seen, r, pending[-1]), strict=True):
            columns[key].append(value)
        r = _rate(MODEL, r, pending.pop(0))
        psi += r * DT
    return _trial(name, columns, marks, {"manoeuvre": "step", "signal": "psi", "size": STEP, "duration": duration})


def trace_of(trial: Trial, seed=7) -> Trace:
    t, measured = trial["psi"].t, trial["psi"].values - 1.2
    fitted = measured + 0.003 * np.sin(0.4 * t) + np.random.default_rng(seed).normal(0.0, 0.001, len(t))
    return Trace(trial.name, t, measured, fitted, np.full(len(t), 0.011))


def fit(
    structure="nonlinear", doubts=(), verdict="nonlinear", traces=(), stds=(0.0011, 0.0, 0.0064, 0.0009)
) -> AxisFit:
    model = replace(MODEL, beta=0.0 if structure == "nonlinear" else MODEL.beta)
    names, units = model.axis.parameter_names(), model.axis.parameter_units("1")
    values = (model.alpha, model.beta, model.beta_quadratic, model.delta)
    parameters = {
        n: Parameter(n, v, u, s, "fitted" if s else "absent")
        for n, v, u, s in zip(names, values, units, stds, strict=True)
    }
    parameters["delay"] = Parameter("delay", 0.2, "s", 0.013)
    cycles = [
        LimitCycle(0.3, 0.1745, 0.1832, 0.41, 0.012, 0.72, 4.5, 4.2, 5, 0.04, True),
        LimitCycle(0.6, 0.1745, 0.1951, 0.47, -0.008, 1.03, 3.1, 3.0, 5, 0.06, True),
    ]
    iso = tuple(
        IsoEstimate(c, 0.186, b, q, 0.011, 0.2) for c, b, q in zip(cycles, (0.21, 0.32), (0.43, 0.42), strict=True)
    )
    sigma = (20.8, 1.2) if verdict != "undecided" else (4.0, 3.1)
    candidates = tuple(
        StructureFit(s, replace(model), rms, -bic / 2, k, bic)
        for s, rms, k, bic in (
            ("linear", 0.0131, 4, -5210.4),
            ("nonlinear", 0.0042, 4, -7730.2),
            ("affine", 0.0042, 5, -7723.9),
        )
    )
    return Fit(
        dof="yaw",
        structure=structure,
        method="output error",
        model=model,
        parameters=parameters,
        covariance=np.diag([s * s for s in (*stds, 0.013)]),
        noise_std=0.0039,
        residual_rms=0.0042,
        fit_percent=98.6,
        used=("relay-1", "relay-2"),
        doubts=tuple(doubts),
        iso=iso,
        decision=Decision(1.4, sigma[0], sigma[1], 1.4, verdict),
        candidates=candidates,
        traces=tuple(traces),
    )


BEFORE = StepMetrics(9.8, 0.41, 1.9, 21.3, 0.021, 0.11)
AFTER = StepMetrics(3.1, 0.06, 2.4, 6.2, 0.008, 0.07)


def _prediction(zeta, omega, metrics) -> Prediction:
    t = np.arange(0.0, 30.0, 0.05)
    wd = omega * math.sqrt(1.0 - zeta**2)
    y = STEP * (1.0 - np.exp(-zeta * omega * t) * (np.cos(wd * t) + zeta * omega / wd * np.sin(wd * t)))
    wanted = STEP * (1.0 - np.exp(-omega * t) * (1.0 + omega * t))
    return Prediction(t, np.full(len(t), STEP), y, wanted, 0.5 * (STEP - y), metrics)


def proposal(worst_stable=True) -> Proposal:
    return Proposal(
        axis="heading",
        law="sub-heading",
        changes=(
            Change("ATC_RAT_YAW_P", 0.18, 0.3471, 0.0, 0.5, "damps the rate loop to the wanted reference model"),
            Change("ATC_RAT_YAW_I", 0.018, 0.05, 0.0, 0.05, "removes the tether's pull; held at its limit"),
            Change("ATC_RAT_YAW_D", 0.0, 0.0012, 0.0, 0.02, "makes up for the delay of 0.2 s"),
            Change("ATC_ANG_YAW_P", 4.5, 1.82, 0.0, 6.0, "sets the speed of the heading loop"),
        ),
        wanted=ReferenceModel("bessel", 1.25, 1.9, 1.4, 0.51),
        margins=Margins(4.2, 1.05, 0.71, True),
        worst_margins=Margins(3.1, 0.86, 0.52, True) if worst_stable else Margins(0.9, -0.1, 0.0, False),
        bound=(3.78, 17.84),
        before=_prediction(0.2, 1.1, StepMetrics(9.1, 0.44, 1.6, 19.8, 0.01, 0.12)),
        after=_prediction(0.85, 1.0, StepMetrics(2.9, 0.03, 2.5, 5.4, 0.0, 0.06)),
        notes=("ATC_RAT_YAW_I would like to be 0.061; the documented limit is 0.05.",),
    )


PARAMETERS = {
    "ATC_RAT_YAW_P": 0.18,
    "ATC_RAT_YAW_I": 0.018,
    "ATC_RAT_YAW_D": 0.0,
    "ATC_ANG_YAW_P": 4.5,
    "ATC_SLEW_YAW": 6000.0,
    "SCHED_LOOP_RATE": 400.0,
}

VEHICLE = {
    "name": "VideoRay Pro (simulated)",
    "firmware": "ArduSub",
    "version": "4.5.0",
    "system_id": 1,
    "link": "sitl:videoray (lock-step child process, seed 1)",
    "simulated": True,
}

WEAK = Doubt(
    "weakly-excited",
    "beta_rr rests on little: its standard error is 41 % of its value",
    "repeat with a relay output at least twice as large",
)


def kept() -> TuneStory:
    relays = (relay_trial(), relay_trial("relay-2", 0.6, seed=4))
    return TuneStory(
        title="tune heading",
        when="2026-11-20T20:12:00+00:00",
        vehicle=VEHICLE,
        axis="heading",
        announced=(
            "arm the vehicle now (it is disarmed) and disarm it at the end",
            "move: 30 deg steps in heading and relay oscillations about the present heading",
            "write up to ATC_RAT_YAW_P, ATC_RAT_YAW_I, ATC_RAT_YAW_D, ATC_ANG_YAW_P after asking again",
        ),
        rates={"ATTITUDE": (10.0, 9.98), "SERVO_OUTPUT_RAW": (10.0, 9.9), "VFR_HUD": (5.0, 3.2)},
        step_before=step_trial(),
        relays=relays,
        step_after=step_trial("step-after", p=0.55, d=0.42, seed=6),
        fit=fit(traces=[trace_of(r) for r in relays]),
        proposal=proposal(),
        metrics_before=BEFORE,
        metrics_after=AFTER,
        kept=True,
        verdict_reasons=("tracking error 68 % lower (at least 5 % wanted)", "overshoot 6 %, no more than before"),
        parameters_before=PARAMETERS,
        parameters_after={**PARAMETERS, **proposal().new},
        events=(
            (math.nan, "link: sitl:videoray"),
            (0.4, "State before the run: mode MANUAL, disarmed"),
            (97.2, "relay-1: completed, 5 periods within 10 % (90 s recorded)"),
            (212.8, "STATUSTEXT: leak detector quiet"),
            (400.1, "mode and armed state restored: MANUAL, disarmed"),
        ),
        ending="kept",
        reason="the new gains are better and stay",
        directory="runs/2026-11-20T20-12-00-heading",
        files=("report.html", "telemetry.tlog", "trials/01-step-before.csv", "parameters_before.param"),
    )


def restored() -> TuneStory:
    return replace(
        kept(),
        ending="restored",
        kept=False,
        reason="the measured comparison failed: tracking error 14 % higher; never settled",
        metrics_after=replace(BEFORE, itae=11.2, overshoot=0.58, settling=math.nan),
        verdict_reasons=("tracking error 14 % higher", "never settled"),
        parameters_after=PARAMETERS,
        fit=fit(doubts=(WEAK,)),
        proposal=proposal(worst_stable=False),
    )


def aborted() -> TuneStory:
    return TuneStory(
        title="tune heading",
        when="2026-11-20T20:12:00+00:00",
        vehicle={**VEHICLE, "simulated": False, "name": "ROV in the harbour", "link": "udpin:0.0.0.0:14550"},
        axis="heading",
        announced=("arm the vehicle now (it is disarmed) and disarm it at the end",),
        rates={"ATTITUDE": (10.0, 9.1)},
        step_before=step_trial(),
        metrics_before=BEFORE,
        parameters_before=PARAMETERS,
        events=((104.2, "step with present gains"), (181.0, "aborted: heading excursion 131 deg, limit 120 deg")),
        ending="aborted",
        reason="heading excursion 131 deg is beyond the limit of 120 deg; give more room with --heading-excursion",
        directory="runs/abort",
        files=("report.html", "telemetry.tlog"),
    )


def never_started() -> TuneStory:
    return TuneStory(
        title="tune heading",
        when="2026-11-20T20:12:00+00:00",
        vehicle={"link": "udpin:0.0.0.0:14550"},
        axis="heading",
        reason="no heartbeat on udpin:0.0.0.0:14550 within 10 s; is the vehicle switched on?",
    )


def dry_run() -> TuneStory:
    return replace(
        kept(),
        ending="dry-run",
        kept=None,
        reason="dry run: nothing was written",
        step_before=None,
        step_after=None,
        metrics_before=None,
        metrics_after=None,
        verdict_reasons=(),
        parameters_after={},
    )


STORIES = {f.__name__: f for f in (kept, restored, aborted, never_started, dry_run)}


def page_of(story) -> str:
    """Return the page of a tune."""
    return to_html(tune_document(story))
