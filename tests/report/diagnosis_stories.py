"""Diagnoses to render: small simulated records, their residuals, and verdicts filled in by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gcs_autotune.diagnose import Cause, Diagnosis, ErrorReduction, Portrait, Ranked, Signature, Value
from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel
from gcs_autotune.identify import Doubt, Trace
from gcs_autotune.models import CoupledModel, Form
from gcs_autotune.report import diagnosis_document, to_html

DT, INERTIA, DRAG, WIDTH, NOISE = 0.1, 2.0, 1.0, 0.3, 0.004
RUNS = ("morning <1>", "noon", "evening")
WHEN = "2026-11-21T10:00:00"
FORM = Form("plain-yaw", "yaw, linear drag", ("yaw",), ("N_rdot", "N_r"), {}, {"N": (("N", 1.0),)}, coriolis=False)


def commands(seed, n=600):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, n // 30), 30)


def turn(tau, drag=DRAG):
    """Rate and heading of INERTIA r' + drag r = tau, exact between samples."""
    r, psi = np.zeros(len(tau)), np.zeros(len(tau))
    decay = math.exp(-DT * drag / INERTIA)
    for k in range(len(tau) - 1):
        steady = tau[k] / drag
        r[k + 1] = steady + (r[k] - steady) * decay
        psi[k + 1] = psi[k] + steady * DT + (r[k] - steady) * (1.0 - decay) * INERTIA / drag
    return r, psi


def correlation(x, y, lags):
    x, y = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
    return np.array([np.mean(x[: len(x) - k] * y[k:]) if k >= 0 else np.mean(x[-k:] * y[:k]) for k in lags])


def portrait(signal, unit, runs):
    """Portrait of (t, measured, simulated, {channel: (values, unit)}) per run; pictures use the first three."""
    traces = tuple(
        Trace(name, t, measured, simulated, np.full(len(t), 1.96 * NOISE), signal, unit)
        for name, (t, measured, simulated, _) in zip(RUNS, runs, strict=True)
    )
    error = np.concatenate([m - s for _, m, s, _ in runs])
    names = {n: u for n, (_, u) in runs[0][3].items()}
    against = {n: (np.concatenate([r[3][n][0] for r in runs]), error, u) for n, u in names.items()}
    against["time"] = (np.concatenate([r[0] for r in runs]), error, "s")
    lags = np.arange(0, 60)
    power = np.abs(np.fft.rfft(error - error.mean())) ** 2 / len(error)
    first = error[: len(runs[0][0])]
    return Portrait(
        signal,
        unit,
        traces,
        against,
        one_step=(runs[0][0], np.diff(first, prepend=first[0])),
        spectrum=(np.fft.rfftfreq(len(error), DT)[1:], power[1:]),
        correlation=(lags * DT, correlation(error, error, lags)),
        cross={"N": (lags * DT, correlation(against["N"][0], error, lags))} if "N" in against else {},
        limit=1.96 / math.sqrt(len(error)),
    )


def portraits(act, sense, drag=DRAG, wave=0.0, explained=False):
    """Rate and heading of a craft with *act* on its commands and *sense* on its compass; residuals of a plain one."""
    rates, headings = [], []
    for seed in range(len(RUNS)):
        rng = np.random.default_rng(100 + seed)
        tau = commands(seed)
        t = np.arange(len(tau)) * DT
        r, psi = turn(act(tau))
        rate, heading = (r, sense(psi)) if explained else turn(tau, drag)
        swell = wave * np.sin(2.0 * np.pi * 0.4 * t + seed)
        driven = {"N": (tau, "N m"), "r": (r, "rad/s"), "psi": (psi % (2.0 * np.pi), "rad")}
        rates.append((t, r + swell + rng.normal(0.0, NOISE, len(t)), rate, driven))
        headings.append((t, sense(psi) + rng.normal(0.0, NOISE, len(t)), heading, driven))
    return portrait("r", "rad/s", rates), portrait("psi", "rad", headings)


SCENE = DataSummary(
    form=FORM,
    inputs={"N": "N m"},
    signals={"psi": "rad", "r": "rad/s"},
    amplitude={"N": 1.0},
    spread={"psi": 1.5, "r": 0.5},
    level={"psi": NOISE, "r": NOISE},
    channels=frozenset({"psi", "r", "N"}),
    interval=DT,
    time_constant=INERTIA / DRAG,
    duration=60.0,
)


def rms(traces):
    return math.sqrt(np.mean(np.concatenate([t.measured - t.fitted for t in traces]) ** 2))


def gains(before, after):
    made = []
    for old, new in zip(before, after, strict=True):
        b, a = rms(old.traces), rms(new.traces)
        held = "each run predicted by a model fitted to the others"
        made.append(
            ErrorReduction(
                "held-out simulation RMSE", old.signal, old.unit, b, a, a / b, (0.85 * a / b, 1.2 * a / b), held
            )
        )
    return tuple(made)


def cause(slug, place, share, **values):
    """A cause from ``name=(value, unit, std)``."""
    applied = EffectInstance(slug, place, {n: v[0] for n, v in values.items()})
    entry = EFFECTS[slug]
    return Cause(applied, {n: Value(*v) for n, v in values.items()}, entry.meaning, share, entry.curve(applied, SCENE))


def ranked(slug, place, gain, p_value, evidence, step=1, **values):
    return Ranked(slug, place, gain, p_value, evidence, {n: Value(*v) for n, v in values.items()}, step)


def diagnosis(before, after, **differences):
    plain = ExtendedModel(CoupledModel(FORM, {"N_rdot": -INERTIA, "N_r": -DRAG}))
    found = tuple(c.effect for c in differences.get("causes", ()))
    improved = gains(before, after) if found else ()
    reported = Diagnosis(
        verdict="no-effect",
        causes=(),
        ranking=(),
        indistinguishable=(),
        gain=improved[0] if improved else None,
        gains=improved,
        base_model=plain,
        extended_model=replace(plain, effects=found),
        next_manoeuvre="",
        left=Signature((), 0.31),
        gave_away=Signature(),
        before=before,
        after=after,
        used=RUNS,
        held_out=("each run in turn",),
        noise={"psi": NOISE, "r": NOISE},
        tried=41,
        seconds=6.4,
    )
    return replace(reported, **differences)


def dead_zone():
    """An effect found: the steering does nothing below 0.3 N m; backlash would explain it nearly as well."""

    def act(tau):
        return np.sign(tau) * np.maximum(np.abs(tau) - WIDTH, 0.0)

    return diagnosis(
        portraits(act, lambda psi: psi, drag=1.35),
        portraits(act, lambda psi: psi, explained=True),
        verdict="effect-found",
        causes=(cause("dead-zone", "N", 0.97, width=(0.302, "N m", 0.006)),),
        ranking=(
            ranked("dead-zone", "N", 0.93, 2e-12, 812.0, width=(0.302, "N m", 0.006)),
            ranked("quadratic-actuator", "N", 0.71, 3e-7, 520.0, share=(0.83, "1", 0.04)),
            ranked("backlash", "N", 0.42, 4e-4, 210.0, width=(0.41, "N m", math.nan)),
            ranked("input-bias", "yaw", 0.01, 0.63, -3.0, bias=(0.002, "N m", 0.004)),
            ranked("gyro-bias", "r", -0.02, 1.0, -5.1, 2, bias=(0.0001, "rad/s", 0.0004)),
        ),
        indistinguishable=(("dead-zone", "quadratic-actuator"),),
        next_manoeuvre="Steps of several sizes, from one small enough to do nothing to full command.",
        gave_away=Signature(
            (
                "The rate's residual goes with the command N: 81 % of it is explained by N alone.",
                "It is slow: neighbouring residuals correlate by 0.97.",
            ),
            0.0,
        ),
    )


def deviation():
    """A compass error that depends on the heading, with a small constant moment: partly explained, swell remains."""

    def sense(psi):
        return psi + 0.12 * np.sin(psi) - 0.07 * np.cos(psi)

    return diagnosis(
        portraits(lambda tau: tau, sense, wave=0.05)[::-1],
        portraits(lambda tau: tau, sense, wave=0.05, explained=True)[::-1],
        verdict="partly-explained",
        causes=(
            cause("compass-deviation", "psi", 0.9, B=(0.121, "rad", 0.003), C=(-0.069, "rad", 0.004)),
            cause("input-bias", "yaw", 0.02, bias=(0.01, "N m", math.nan)),
        ),
        ranking=(
            ranked("compass-deviation", "psi", 0.6, 1e-300, 500.0, B=(0.121, "rad", 0.003), C=(-0.069, "rad", 0.004)),
            ranked("input-bias", "yaw", 0.05, 0.012, 9.0, 2, bias=(0.01, "N m", math.nan)),
        ),
        next_manoeuvre="Two slow full turns, one each way.",
        left=Signature(("A narrow peak at 0.40 Hz holds 88 % of what is left of r.",), 1e-9),
        gave_away=Signature(("The heading's residual makes one wave per turn.",), 0.0),
        doubts=(Doubt("short", "the third run is short", "fly it for longer"),),
    )


def unexplained():
    """Structure that no candidate explains."""
    before = portraits(lambda tau: tau, lambda psi: psi, wave=0.08)
    return diagnosis(
        before,
        before,
        verdict="unexplained",
        ranking=(ranked("dead-zone", "N", 0.01, 0.7, -2.0, width=(0.02, "N m", 0.03)),),
        left=Signature(("A peak at 0.40 Hz holds 93 % of the rate's residual.",), 1e-12),
        gave_away=Signature(("A peak at 0.40 Hz holds 93 % of the rate's residual.",), 1e-12),
        next_manoeuvre="The same manoeuvre in flat water.",
    )


def nothing():
    """A plain simulation that is right."""
    before = portraits(lambda tau: tau, lambda psi: psi)
    return diagnosis(before, before, gave_away=Signature((), 0.31))


def bare():
    """As little as there can be: no portrait, no ranking, numbers that are not known."""
    reported = nothing()
    unknown = ErrorReduction(
        "held-out simulation RMSE", "r", "rad/s", math.nan, math.nan, math.nan, (math.nan, math.nan)
    )
    return replace(
        reported, before=(), after=(), gain=unknown, gains=(unknown,), noise={}, left=Signature(), held_out=(), tried=0
    )


STORIES = {"dead-zone": dead_zone, "deviation": deviation, "unexplained": unexplained, "nothing": nothing, "bare": bare}


def page_of(told, *about, **more):
    """Return the page of a diagnosis."""
    return to_html(diagnosis_document(told, *about, **more))
