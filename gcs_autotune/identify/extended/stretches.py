"""Runs made ready for a diagnosis: which base model they are about, and their uninterrupted stretches.

Unlike identification nothing is mended here on the way in: a wrong unit or sign is what a diagnosis is to find.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import DataSummary, Passage, passage_of
from gcs_autotune.errors import MissingChannel, NotInformative, UsageError
from gcs_autotune.identify.axis.record import INPUTS, MIN_SAMPLES, dating_of
from gcs_autotune.identify.coupled.record import CoupledRecord, pieces_of, prepare_coupled, signals_of, within_horizon
from gcs_autotune.identify.coupled.smoothing import first_levels_of
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models.coupled import FORMS, Form
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["Stretch", "overlooked", "plain_form", "scene_of", "stretches_of", "within", "without"]

Array = NDArray[np.float64]

THRUSTERS = ("force_left", "force_right")
"""Channels of a boat steered by two fixed thrusters, as in the form ``twin-thruster``."""

TRACK = {"x", "y", "psi"}
"""Signals that show surge and sway where no speed is recorded."""

TURN_RATES = ("p", "q", "r")
"""Signals that have passed the autopilot's gyro filter."""

FULL_TURN = {"rad": 2.0 * np.pi, "deg": 360.0}


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """One uninterrupted stretch: its signals, and how a simulation passes over it.

    ``dating`` [s]: how far the stamps of its inputs may be off, all by the same (decision 3); 0 when they are exact.
    ``lags`` [s]: signal -> how late a filter aboard made it, where its stamps have been dated back by that.
    """

    record: CoupledRecord
    passage: Passage
    form: Form
    dating: float = 0.0
    lags: Mapping[str, float] = field(default_factory=dict)

    @property
    def run(self) -> str:
        """Name of the run."""
        return self.passage.run

    def late(self, shift: float) -> Passage:
        """Return the passage with its inputs *shift* [s] later than stamped; as it is when stamps are exact."""
        return replace(self.passage, t_in=self.passage.t_in + shift) if shift and self.dating else self.passage

    def pieces(self, count: int) -> list[Stretch]:
        """Cut into *count* stretches of about as many stamps each; commands stay whole."""
        return [
            _stretch(piece, self.passage.run, self.passage.measured, self.form, self.dating, self.lags)
            for piece in pieces_of(self.record, count)
        ]

    def within(self, horizon: float) -> list[Stretch]:
        """Cut into stretches no longer than *horizon* [s], none shorter than can be fitted; commands stay whole."""
        return [
            _stretch(piece, self.passage.run, self.passage.measured, self.form, self.dating, self.lags)
            for piece in within_horizon(self.record, horizon)
        ]


def plain_form(runs: Sequence[Trial], dof: str | None = None) -> Form:
    """Return the base model: the degrees of freedom in the file, uncoupled, with linear damping.

    dof : names joined by commas, to look at these only, or that of a shipped form (``horizontal``) for all it has;
        None: what the records say they swung, else all there are.

    A track (x, y and the heading) without speeds shows surge and sway too, where something drives the heading.

    Raises
    ------
    MissingChannel
        No degree of freedom has both something that drives it and something measured.
    """
    there = {n for run in runs for n, c in run.channels.items() if len(c) >= MIN_SAMPLES}
    varies = {
        n for run in runs for n, c in run.channels.items() if len(c) and np.ptp(c.values[np.isfinite(c.values)]) > 0
    }
    asked = asked_for(runs, dof)
    if set(THRUSTERS) <= there:
        return _twin_thruster(asked, there)
    steered = any(c in varies for c in INPUTS["yaw"]) and (asked is None or "yaw" in asked)
    track = steered and TRACK <= there and not {"u", "v"} & there
    pushed = {n for run in runs for n, c in run.channels.items() if len(c) and np.any(c.values)} if track else set()
    dofs, inputs, free = [], {}, []
    for name in ("surge", "sway", "heave", "roll", "pitch", "yaw"):
        d = DOFS[name]
        drives = [c for c in INPUTS[name] if c in there]
        drive = next((c for c in drives if c in varies), None)
        if drive is None and name == "surge":
            drive = next((c for c in drives if c in pushed), None)
        seen = {d.velocity, d.position} & there
        if name == "surge" and d.velocity not in there and "psi" in there and not track:
            seen = set()
        if (asked is not None and name not in asked) or drive is None or not seen:
            continue
        dofs.append(name)
        inputs[drive] = ((d.force, 1.0),)
        free += [f"{d.force}_{d.velocity}dot", f"{d.force}_{d.velocity}"]
    known = {}
    adrift = "sway" not in dofs and {"surge", "yaw"} <= set(dofs) and ("v" in there or track)
    if adrift and (asked is None or "sway" in asked):
        dofs.insert(1, "sway")
        known["Y_vdot"] = -1.0
        free.append("Y_v")
    if not dofs:
        have = ", ".join(sorted(there)) or "nothing"
        raise MissingChannel(
            "no degree of freedom has both a varying input and a measured motion (for yaw: N[N m] or delta[rad] with "
            f"psi[rad] or r[rad/s]; surge: X and u; heave: Z and z or w); the runs have {have}"
        )
    title = "uncoupled, linear damping: " + ", ".join(dofs)
    return Form("plain", title, tuple(dofs), tuple(free), known, inputs, coriolis=False)


def asked_for(runs: Sequence[Trial], dof: str | None) -> list[str] | None:
    """Return the degrees of freedom to look at, see :func:`plain_form`; None for all there are.

    Raises
    ------
    MissingChannel
        A name that is neither a degree of freedom nor a shipped form.
    """
    if dof is None:
        return swung(runs)
    names = [d.strip() for d in dof.split(",")]
    strange = [d for d in names if d not in DOFS and d not in FORMS]
    if strange:
        raise MissingChannel(
            f"no degree of freedom called {', '.join(strange)}; there are {', '.join(DOFS)}, and for several at once "
            f"{', '.join(FORMS)}"
        )
    return list(dict.fromkeys(d for n in names for d in (FORMS[n].dofs if n in FORMS else (n,))))


def overlooked(
    runs: Sequence[Trial], form: Form, dof: str | None, use: Sequence[str] | None, stretches: Sequence[Stretch]
) -> list[Doubt]:
    """Return a doubt for what was asked for, or recorded of the plane, and could not be looked at."""
    asked = asked_for(runs, dof)
    found = []
    missing = [d for d in asked or () if d not in form.dofs] if dof is not None else []
    if missing:
        columns = "; ".join(
            f"{d}: {' or '.join(INPUTS[d])} and {DOFS[d].velocity} or {DOFS[d].position}" for d in missing
        )
        found.append(
            Doubt(
                "not-looked-at",
                f"{', '.join(missing)} was asked for and not looked at: nothing recorded drives and shows it",
                f"record what is wanted of it ({columns})",
            )
        )
    compared = {n for s in stretches for n in s.record.signals}
    moving = {
        n for run in runs for n in ("x", "y") if n in run and len(run[n]) >= MIN_SAMPLES and np.ptp(run[n].values) > 0.0
    }
    left = sorted(moving - compared)
    if left and use is None and (asked is None or {"surge", "sway"} & set(asked)):
        found.append(
            Doubt(
                "not-looked-at",
                f"{' and '.join(left)} were recorded and not compared: this model does not move on the plane with what "
                "was recorded, so what happens to the track alone was not seen",
                "record the thrust (X) and the speeds u and v, or only x, y and psi beside X and N",
            )
        )
    return found


def swung(runs: Sequence[Trial]) -> list[str] | None:
    """Return the degree of freedom the records of all *runs* say was swung; None when not all say the same.

    The others were kept still by a controller meanwhile: what they tell is how well it did.
    """
    told = {run.meta.get("dof") for run in runs}
    return [str(d) for d in told] if len(told) == 1 and told <= set(DOFS) else None


def _twin_thruster(asked: Sequence[str] | None, there: Collection[str]) -> Form:
    left, right = THRUSTERS
    dofs = [d for d in ("surge", "yaw") if DOFS[d].velocity in there or (d == "yaw" and "psi" in there)]
    dofs = [d for d in dofs if asked is None or d in asked]
    inputs: dict[str, tuple[tuple[str, float | str], ...]] = {left: (), right: ()}
    free: list[str] = []
    if "surge" in dofs:
        inputs = {c: (*g, ("X", 1.0)) for c, g in inputs.items()}
        free += ["X_udot", "X_u"]
    if "yaw" in dofs:
        inputs = {left: (*inputs[left], ("N", "k_N")), right: (*inputs[right], ("N", "-k_N"))}
        free += ["k_N", "N_r"]
    known = {"I_z": 1.0} if "yaw" in dofs else {}
    if not dofs:
        raise MissingChannel(f"two thrusters are recorded, but none of u, r, psi: {', '.join(sorted(there))}")
    return Form("plain", "two fixed thrusters, linear damping", tuple(dofs), tuple(free), known, inputs, coriolis=False)


def stretches_of(
    runs: Sequence[Trial], form: Form, use: Sequence[str] | None = None
) -> tuple[list[Stretch], list[Doubt]]:
    """Return the stretches of all runs, and what is doubtful about them.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        As :func:`gcs_autotune.identify.coupled.record.prepare_coupled`.
    """
    found: list[Stretch] = []
    doubts: list[Doubt] = []
    failures: list[tuple[str, NotInformative]] = []
    for run in runs:
        ready = _with_continuous_heading(run)
        names = list(use) if use is not None else _signals(ready, form)
        try:
            records = prepare_coupled(ready, form, names, continuous=True)
        except NotInformative as error:
            failures.append((run.name, error))
            continue
        measured = {n: c for n, c in ready.channels.items() if len(c)}
        dating = max((dating_of(ready, ready[n]) for n in form.inputs), default=0.0)
        for record in records:
            found.append(_stretch(record, run.name, measured, form, dating, _lags_of(ready)))
            doubts += record.notes
    if not found:
        raise failures[0][1]
    doubts += [
        Doubt("run-left-out", f"run '{name}' was left out: {error}", "mend or drop that run")
        for name, error in failures
    ]
    return found, doubts


def within(stretches: Sequence[Stretch], horizon: float) -> list[Stretch]:
    """Cut stretches into such no longer than *horizon* [s], each with initial states of its own.

    Raises
    ------
    UsageError
        A horizon that is not above zero.
    """
    if not horizon > 0.0:
        raise UsageError(f"a horizon of {horizon} s makes no sense: give seconds above 0, or inf for whole runs")
    return [piece for s in stretches for piece in (s.within(horizon) if math.isfinite(horizon) else [s])]


def without(stretches: Sequence[Stretch], name: str) -> list[Stretch]:
    """Return the stretches without one of their signals; those that have no other are left out."""
    found = []
    for s in stretches:
        others = {n: signal for n, signal in s.record.signals.items() if n != name}
        if others:
            record = replace(s.record, signals=others)
            found.append(_stretch(record, s.run, s.passage.measured, s.form, s.dating, s.lags))
    return found


def _signals(run: Trial, form: Form) -> list[str]:
    """Return every measured signal the form predicts; of positions in the plane only with the heading to turn them."""
    there = [n for n in signals_of(form) if n in run and len(run[n]) >= MIN_SAMPLES]
    planar = "psi" in run and "psi" not in there
    if planar or ("sway" not in form.dofs and "psi" in run):
        there = [n for n in there if n not in ("x", "y")]
    if not there:
        wanted = ", ".join(signals_of(form))
        raise MissingChannel(f"run '{run.name}' has none of {wanted} in at least {MIN_SAMPLES} samples")
    return there


def _with_continuous_heading(run: Trial) -> Trial:
    """Return *run* with its headings made continuous, whatever unit they are really in."""
    channels = dict(run.channels)
    for name in ("psi", "phi", "theta"):
        if name in channels and len(channels[name]) > 1:
            channels[name] = _continuous(channels[name])
    return replace(run, channels=channels)


def _continuous(angle: Channel) -> Channel:
    values = angle.values
    good = values[np.isfinite(values)]
    if not len(good):
        return angle
    span = float(np.ptp(good))
    jumps = np.abs(np.diff(good))
    for turn in FULL_TURN.values():
        wraps = (jumps > 0.6 * turn) & (jumps < 1.001 * turn)
        if span <= 1.001 * turn and wraps.any():
            return replace(angle, values=np.where(np.isfinite(values), _unwrapped(values, turn), values))
    return angle


def _unwrapped(values: Array, turn: float) -> Array:
    held = values.copy()
    for i in range(1, len(held)):
        if not np.isfinite(held[i]):
            held[i] = held[i - 1]
    unwrapped: Array = np.unwrap(held, period=turn)
    return unwrapped


def _lags_of(trial: Trial) -> dict[str, float]:
    lag = float(trial.meta.get("rate_lag", 0.0) or 0.0)
    return dict.fromkeys(TURN_RATES, lag) if lag > 0.0 else {}


def _stretch(
    record: CoupledRecord,
    run: str,
    measured: Mapping[str, Channel],
    form: Form,
    dating: float,
    lags: Mapping[str, float],
) -> Stretch:
    commands = {n: np.ascontiguousarray(record.inputs[:, i]) for i, n in enumerate(form.inputs)}
    passage = passage_of(run, record.t_in, commands, {n: s.t for n, s in record.signals.items()}, measured)
    return Stretch(record, passage, form, dating, lags)


def scene_of(form: Form, stretches: Sequence[Stretch], base: Mapping[str, float] | None = None) -> DataSummary:
    """Return what may be known of the runs before any effect is fitted; *base*: values of the base model."""
    records = [s.record for s in stretches]
    signals = {n: SIGNALS[n][0] for r in records for n in r.signals}
    units = dict(zip(form.inputs, records[0].input_units, strict=True))
    values = {n: np.concatenate([r.signals[n].values for r in records if n in r.signals]) for n in signals}
    measured: dict[str, list[Array]] = {}
    for stretch in {s.run: s for s in stretches}.values():
        for name, channel in stretch.passage.measured.items():
            good = channel.values[np.isfinite(channel.values)]
            if len(good):
                measured.setdefault(name, []).append(good)
    joined = {n: np.concatenate(parts) for n, parts in measured.items()}
    steps = [float(np.median(np.diff(s.t))) for r in records for s in r.signals.values() if len(s.t) > 1]
    inertia = [(f"{DOFS[d].force}_{DOFS[d].velocity}") for d in form.dofs]
    paces = [abs(base[f"{n}dot"] / base[n]) for n in inertia if base and base.get(n) and f"{n}dot" in base]
    return DataSummary(
        form=form,
        inputs=units,
        signals=signals,
        amplitude={n: max(float(np.abs(s.passage.commands[n]).max()) for s in stretches) for n in form.inputs},
        spread={n: max(float(np.std(v)), 1e-12) for n, v in values.items()},
        level=first_levels_of(records),
        channels=frozenset(joined),
        interval=float(np.median(steps)),
        pace=float(np.clip(max(paces, default=1.0), 1e-2, 1e3)),
        duration=max(float(r.stamps[-1]) - r.start for r in records),
        quantum={n: max(r.signals[n].step for r in records if n in r.signals) for n in signals},
        extent={n: (float(v.min()), float(v.max())) for n, v in joined.items()},
        rms={n: float(np.sqrt(np.mean(v**2))) for n, v in joined.items()},
        base=dict(base or {}),
        runs=tuple(dict.fromkeys(s.run for s in stretches)),
        lags={n: max(s.lags.get(n, 0.0) for s in stretches) for n in signals},
    )
