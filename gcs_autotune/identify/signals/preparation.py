"""Convert recorded runs to segments: channels chosen, cleaned, unwrapped, cut at gaps.

Nothing is resampled or smoothed. What is removed is counted and noted as a doubt. :func:`prepare` is for one degree of
freedom and :func:`prepare_form` for a form. :func:`prepare_as_recorded` is for a fit with effects. It corrects nothing,
because a diagnosis must be able to find a wrong unit or sign.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import MissingChannel, NotInformative, UsageError
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.signals.along_axis import DISTANCE, ahead_doubt, projected_track, with_distance_ahead
from gcs_autotune.identify.signals.cleaning import (
    clean,
    continuous,
    gaps_in,
    holes_of,
    noted,
    outside,
    unstuck,
    unwrap,
    within_range,
)
from gcs_autotune.identify.signals.intake import left_out
from gcs_autotune.identify.signals.segment import MIN_SAMPLES, MOST_ALIKE, Segment, Signal
from gcs_autotune.models import FORMS, Form
from gcs_autotune.registry import lookup
from gcs_autotune.rounding import counted
from gcs_autotune.sensor import INDEPENDENT, TURN, quantum
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Channel, Trial

__all__ = [
    "INPUTS",
    "WITHIN_LOOP",
    "form_driven",
    "guess_dof",
    "prepare",
    "prepare_as_recorded",
    "prepare_form",
    "signals_of",
    "since_release",
]

Array = NDArray[np.float64]

INPUTS: dict[str, tuple[str, ...]] = {
    "yaw": ("N", "delta"),
    "heave": ("Z",),
    "surge": ("X",),
    "sway": ("Y",),
    "roll": ("K",),
    "pitch": ("M",),
}
"""Degree of freedom -> channels that may be its input, preferred first."""

WITHIN_LOOP = 0.25
"""Fraction of an autopilot's loop time by which outputs and attitudes from the same loop may differ. Project choice."""

TRANSITION = 4.0
"""Smallest ratio of a velocity's standard deviation to its noise for a change from one steady value to another.

Project choice.
"""

SETTLED = 2.0
"""Largest ratio of a velocity's standard deviation to its noise for the velocity to count as settled. Project choice.

The ratio is that of the second half of the velocity.
"""

LEAST_OWN = 0.05
"""Smallest standard deviation of a sample without its common errors, as a fraction of the whole. Project choice.

Without a limit, rounding of a file would decide on it.
"""
TURN_RATES = ("p", "q", "r")
"""Names of the signals that the autopilot's gyro filter delays."""

_VELOCITIES = frozenset(d.velocity for d in DOFS.values())


def signals_of(form: Form) -> tuple[str, ...]:
    """Return the names of the signals that *form* predicts: velocities, then positions."""
    dofs = [DOFS[d] for d in form.dofs]
    return (*(d.velocity for d in dofs), *(d.position for d in dofs))


def guess_dof(trial: Trial) -> Dof:
    """Return the degree of freedom of a run, from its metadata or from its varying inputs.

    Raises
    ------
    MissingChannel
        There is no pair of input and output.
    UsageError
        There is more than one pair whose input varies.
    """
    dof_name = trial.meta.get("dof")
    if isinstance(dof_name, str) and dof_name in DOFS:
        return DOFS[dof_name]
    pairs = [d for d in DOFS.values() if _input_names(trial, d) and _output_names(trial, d)]
    moving = [d for d in pairs if any(_varies(trial[n]) for n in _input_names(trial, d))]
    if len(moving) > 1:  # an autopilot levels the craft during every manoeuvre
        moving = [d for d in moving if not d.restored] or moving
    if len(moving) == 1:
        return moving[0]
    have = ", ".join(trial.channels) or "nothing"
    if not pairs:
        raise MissingChannel(
            f"run '{trial.name}' has no input with its output. Its columns are {have}. It needs a pair such as N (or "
            f"delta) with psi or r, Z with z or w, X with u or x, Y with v or y{_several_at_once(trial)}"
        )
    if not moving:
        if len(pairs) == 1:
            return pairs[0]
        raise NotInformative(f"no input of run '{trial.name}' ever changes, so nothing can be identified from it")
    names = ", ".join(d.name for d in moving)
    raise UsageError(f"run '{trial.name}' moves in several degrees of freedom ({names}). Choose one with --dof")


def form_driven(runs: Sequence[Trial]) -> Form | None:
    """Return the only shipped form whose inputs all *runs* contain, or None.

    The function is for boats that a single degree of freedom cannot describe. An example is a boat with two thrusters
    side by side, which push and turn it at the same time.
    """
    if any(_input_names(run, d) and _output_names(run, d) for run in runs for d in DOFS.values()):
        return None
    forms = [f for f in FORMS.values() if runs and all(_drives(f, run) for run in runs)]
    return forms[0] if len(forms) == 1 else None


def _drives(form: Form, trial: Trial) -> bool:
    return all(n in trial and len(trial[n]) for n in form.inputs)


def _several_at_once(trial: Trial) -> str:
    """Return a sentence with the forms whose inputs *trial* contains, or an empty text."""
    forms = [f"--dof {f.name}" for f in FORMS.values() if _drives(f, trial)]
    return f". Its inputs drive several degrees of freedom at once: {' or '.join(forms)}" if forms else ""


def _input_names(trial: Trial, dof: Dof) -> list[str]:
    return [n for n in INPUTS[dof.name] if n in trial and len(trial[n])]


def _output_names(trial: Trial, dof: Dof) -> list[str]:
    other = (DISTANCE,) if dof.name == "surge" else ()
    return [n for n in (dof.position, dof.velocity, *other) if n in trial and len(trial[n])]


def _varies(channel: Channel) -> bool:
    return bool(np.nanmin(channel.values) < np.nanmax(channel.values)) if len(channel) else False


def prepare(trial: Trial, dof: Dof | str) -> tuple[Segment, ...]:
    """Return the usable segments of *trial* for one degree of freedom.

    For surge and sway, the position is the distance travelled ahead or to starboard. The distance travelled comes from
    the distance to a wall ahead if that was measured, otherwise from the track.

    Raises
    ------
    MissingChannel
        There is no input or no output for this degree of freedom.
    BadFile
        The clock jumps back.
    NotInformative
        There are too few samples, the input is constant, or the output never changes.
    """
    axis = lookup(DOFS, dof, "degree of freedom") if isinstance(dof, str) else dof
    measured = trial
    trial = with_distance_ahead(trial) if axis.name == "surge" else trial
    names, outputs = _input_names(trial, axis), _output_names(trial, axis)
    if not names or not outputs:
        want = f"{' or '.join(INPUTS[axis.name])} with {axis.position} or {axis.velocity}"
        raise MissingChannel(
            f"run '{trial.name}' lacks what {axis.name} needs ({want}). Its columns are "
            f"{', '.join(trial.channels)}{_several_at_once(trial)}"
        )
    source = next((n for n in names if _varies(trial[n])), names[0])
    doubt = ahead_doubt(trial) if trial is not measured else None
    notes = [*noted(trial), *([] if doubt is None else [doubt])]
    drive = clean(trial[source], trial.name, notes)
    rate = _measured(trial, axis.velocity, notes) if axis.velocity in outputs else None
    position = _measured(trial, axis.position, notes) if axis.position in outputs else None
    if position is not None and trial is measured:
        position = projected_track(trial, axis, position, notes, needed=rate is None)
    hidden = holes_of(drive, trial.name, notes)
    rate = None if rate is None else outside(rate, hidden)
    position = None if position is None else outside(position, hidden)
    _check_excitation(trial, drive, [c for c in (position, rate) if c is not None])
    if position is not None and rate is not None and _varies(position) is not _varies(rate):
        dead = rate if _varies(position) else position
        position, rate = (None if c is dead else c for c in (position, rate))
        cause = f"{dead.name} of run '{trial.name}' never changes, so it was left out"
        notes.append(Doubt("dead-column", cause, "check that sensor"))
    if position is not None and axis.angular:
        position = replace(position, values=unwrap(position.t, position.values, rate))
    main = position if position is not None and len(position) >= MIN_SAMPLES else rate
    assert main is not None
    channels = {c.name: c for c in (position, rate) if c is not None}
    return _cut(trial, [drive], channels, main.t, notes)


def since_release(runs: Sequence[Trial], records: Sequence[Segment]) -> list[Segment]:
    """Return the segments of *runs*, those of a decay from its release on (mark ``release``).

    Before it the thrusters hold the craft with a small output. There their gain differs from that of a relay: on a
    simulated BlueROV2 by a factor of 2.4 in pitch. After it no thruster acts.
    """
    released = {run.name: mark.t for run in runs for mark in run.marks if mark.kind == "release"}
    return [record.since(released.get(record.run, record.start)) for record in records]


def _check_excitation(trial: Trial, drive: Channel, outputs: Sequence[Channel]) -> None:
    most = max((len(c) for c in outputs), default=0)
    if most < MIN_SAMPLES:
        raise NotInformative(
            f"run '{trial.name}' is too short. It has {most} output samples, but at least {MIN_SAMPLES} are needed. "
            "Record longer"
        )
    overlap = drive.t[(drive.t <= outputs[0].t[-1])] if len(drive) else drive.t
    if len(overlap) == 0 or not _varies(drive.between(-np.inf, float(outputs[0].t[-1]))):
        raise NotInformative(
            f"the input {drive.name} of run '{trial.name}' never changes while the output is recorded. Inertia, "
            "damping and constant force cannot be separated. Fly a relay or a sequence of steps"
        )
    if not any(_varies(c) for c in outputs):
        names = " and ".join(c.name for c in outputs)
        raise NotInformative(
            f"the craft does not move in run '{trial.name}', since {names} never changes. Check sensor and actuator"
        )


def prepare_form(
    trial: Trial, form: Form, use: Sequence[str] | None = None, *, continuous: bool = False
) -> tuple[Segment, ...]:
    """Return the usable segments of *trial* for *form*.

    Parameters
    ----------
    use : names of the signals to use. None uses all measured velocities and angles, and those positions whose velocity
        was not measured.
    continuous : whether the angles are already without jumps of a full turn.

    Raises
    ------
    MissingChannel
        An input of the form, or every signal, is missing.
    BadFile
        The clock jumps back.
    NotInformative
        There are too few samples, no input changes, or no output changes.
    """
    absent = [c for c in form.inputs if c not in trial or not len(trial[c])]
    if absent:
        have = ", ".join(trial.channels) or "nothing"
        raise MissingChannel(
            f"run '{trial.name}' lacks the input {', '.join(absent)} of '{form.name}'. Its columns are {have}"
        )
    names = _names(trial, form, use)
    notes = noted(trial)
    drives = [clean(trial[c], trial.name, notes) for c in form.inputs]
    channels = {n: _measured(trial, n, notes) for n in names}
    for name, channel in channels.items():
        dof = next(d for d in DOFS.values() if name in (d.position, d.velocity))
        if name == dof.position and dof.angular and not continuous:
            channels[name] = replace(channel, values=unwrap(channel.t, channel.values, channels.get(dof.velocity)))
    for drive in drives:
        hidden = holes_of(drive, trial.name, notes)
        channels = {n: outside(c, hidden) for n, c in channels.items()}
    _check_form(trial, form, drives, channels)
    return _cut(trial, drives, channels, np.unique(np.concatenate([c.t for c in channels.values()])), notes)


def _measured(trial: Trial, name: str, notes: list[Doubt]) -> Channel:
    return unstuck(clean(trial[name], trial.name, notes), trial.name, notes)


def _names(trial: Trial, form: Form, use: Sequence[str] | None) -> list[str]:
    there = [n for n in signals_of(form) if n in trial and len(trial[n]) >= MIN_SAMPLES]
    if use is not None:
        missing = [n for n in use if n not in there]
        if missing:
            have = ", ".join(there) or "nothing"
            raise MissingChannel(
                f"run '{trial.name}' has no {', '.join(missing)} for '{form.name}'. Its columns are {have}"
            )
        return list(use)
    dofs = [DOFS[d] for d in form.dofs]
    taken = [d.velocity for d in dofs if d.velocity in there]
    taken += [d.position for d in dofs if d.position in there and (d.angular or d.velocity not in there)]
    if not taken:
        raise MissingChannel(
            f"run '{trial.name}' has none of the signals of '{form.name}' ({', '.join(signals_of(form))}) in at "
            f"least {MIN_SAMPLES} samples. Its columns are {', '.join(trial.channels)}"
        )
    return taken


def _check_form(trial: Trial, form: Form, drives: Sequence[Channel], channels: Mapping[str, Channel]) -> None:
    end = max(float(c.t[-1]) for c in channels.values())
    moving = [d for d in drives if len(d) and np.ptp(d.between(-np.inf, end).values) > 0.0]
    if form.inputs and not moving and not any(_gathers_way(c) for n, c in channels.items() if n in _VELOCITIES):
        raise NotInformative(
            f"no input of run '{trial.name}' ({', '.join(form.inputs)}) ever changes, so inertia and drag cannot be "
            "separated. Fly steps, a zig-zag or a relay"
        )
    if all(np.ptp(c.values) == 0.0 for c in channels.values()):
        raise NotInformative(
            f"the craft does not move in run '{trial.name}', since {', '.join(channels)} never change. Check "
            "sensor and actuator"
        )


def _gathers_way(velocity: Channel) -> bool:
    """Return whether a velocity changes from one steady value to another.

    Such a change identifies the craft even under constant inputs. A velocity that never settles under constant inputs
    has another cause: a faulty log, wind or waves.
    """
    values = velocity.values
    noise = float(np.std(np.diff(values))) / math.sqrt(2.0)
    late = float(np.std(values[len(values) // 2 :]))
    return float(np.std(values)) > TRANSITION * noise and late < max(SETTLED * noise, 1e-12)


def prepare_as_recorded(
    runs: Sequence[Trial], form: Form, use: Sequence[str] | None = None
) -> tuple[list[Segment], list[Doubt]]:
    """Return the segments of all runs for a fit with effects, and the doubts about them.

    All measured signals that the form predicts are used. North and east positions are used only together with the
    heading.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        No run can be used. The exception is that of :func:`prepare_form` for the first run.
    """
    prepared: list[Segment] = []
    doubts: list[Doubt] = []
    failures: list[tuple[str, NotInformative]] = []
    for run in runs:
        ready = _with_continuous_heading(run)
        names = list(use) if use is not None else _all_signals(ready, form)
        try:
            segments = prepare_form(ready, form, names, continuous=True)
        except NotInformative as error:
            failures.append((run.name, error))
            continue
        prepared += segments
        doubts += [note for segment in segments for note in segment.notes]
    if not prepared:
        raise failures[0][1]
    doubts += [left_out(name, error) for name, error in failures]
    return prepared, doubts


def _all_signals(run: Trial, form: Form) -> list[str]:
    there = [n for n in signals_of(form) if n in run and len(run[n]) >= MIN_SAMPLES]
    planar = "psi" in run and "psi" not in there
    if planar or ("sway" not in form.dofs and "psi" in run):
        there = [n for n in there if n not in ("x", "y")]
    if not there:
        wanted = ", ".join(signals_of(form))
        raise MissingChannel(f"run '{run.name}' has none of {wanted} in at least {MIN_SAMPLES} samples")
    return there


def _with_continuous_heading(run: Trial) -> Trial:
    """Return *run* with continuous headings, whether their values are in radians or degrees."""
    channels = dict(run.channels)
    for name in ("psi", "phi", "theta"):
        if name in channels and len(channels[name]) > 1:
            channels[name] = continuous(channels[name])
    return replace(run, channels=channels)


def _cut(
    trial: Trial, drives: Sequence[Channel], channels: Mapping[str, Channel], t: Array, notes: list[Doubt]
) -> tuple[Segment, ...]:
    """Return the segments between the gaps in *t*, the stamps of the outputs."""
    borders = _edges(t)
    if len(borders) > 2:
        stuck = any(note.slug == "stuck-sensor" for note in notes)
        where, cure = (", or a stuck sensor", "") if stuck else ("", ". Stay within good radio range")
        notes.append(
            Doubt(
                "gaps",
                f"run '{trial.name}' has {counted(len(borders) - 2, 'gap')} in its telemetry{where}",
                f"each part was fitted with its own initial state{cure}",
            )
        )
    channels = {n: within_range(c, trial.name, notes) for n, c in channels.items()}
    t_in, table, slack = _joined(trial, drives)
    lag = float(trial.meta.get("rate_lag", 0.0) or 0.0)
    whole = Segment(
        name=trial.name,
        run=trial.name,
        t_in=t_in,
        inputs=table,
        input_names=tuple(d.name for d in drives),
        input_units=tuple(d.unit for d in drives),
        signals={},
        dating=max((_dating_of(trial, d) for d in drives), default=0.0),
        slack=slack,
        loop=float(trial.meta.get("loop_period", 0.0)),
        lags=dict.fromkeys(TURN_RATES, lag) if lag > 0.0 else {},
        measured={n: c for n, c in trial.channels.items() if len(c)},
    )
    parts: list[Segment] = []
    for start, end in itertools.pairwise(borders):
        signals = {}
        for name, channel in channels.items():
            keep = (channel.t >= start) & (channel.t < end)
            if int(keep.sum()) >= MIN_SAMPLES:
                t, values = channel.t[keep], channel.values[keep]
                step = quantum(values, TURN if name == "psi" else 0.0)
                signals[name] = Signal(name, t, values, step, *_errors_of(trial, name, t))
        if signals:
            name = trial.name if len(borders) == 2 else f"{trial.name}#{len(parts) + 1}"
            parts.append(replace(whole, name=name, signals=signals, notes=() if parts else tuple(notes)))
    if not parts:
        raise NotInformative(
            f"run '{trial.name}' has no uninterrupted stretch of {MIN_SAMPLES} samples. Stay within good radio range"
        )
    return tuple(parts)


def _errors_of(trial: Trial, name: str, t: Array) -> tuple[Array, Array, Array]:
    """Return standard deviations (n,), correlation times (n,) [s] and common errors (n, c) of samples at *t*.

    Each is empty if the run does not contain it. The channels ``std_u``, ``memory_u`` and ``common1_u`` contain those
    of ``u``; ``navigate`` writes them. The first two are returned without the part of the common errors.
    """
    std, memory = (trial.channels.get(f"{word}_{name}") for word in ("std", "memory"))
    if std is None or not len(std) or not np.all(std.values > 0.0):
        return np.zeros(0), np.zeros(0), np.zeros((0, 0))
    sizes = np.interp(t, std.t, std.values)
    times = np.zeros(0) if memory is None or not len(memory) else np.interp(t, memory.t, memory.values)
    causes = itertools.takewhile(bool, (trial.channels.get(f"common{i}_{name}") for i in itertools.count(1)))
    columns = [np.interp(t, c.t, c.values) for c in causes if c is not None]
    if not columns:
        return sizes, times, np.zeros((0, 0))
    common = np.column_stack(columns)
    return *_without_common(t, sizes, times, common), common


def _without_common(t: Array, std: Array, memory: Array, common: Array) -> tuple[Array, Array]:
    """Return standard deviations (n,) and correlation times (n,) [s] of the part of an error that is not *common*."""
    rest = np.sqrt(np.maximum(std**2 - np.sum(common**2, axis=1), (LEAST_OWN * std) ** 2))
    if not len(memory):
        return rest, memory
    step = np.diff(t)
    alike = np.where(memory[1:] > 0.0, np.exp(-step / np.maximum(memory[1:], 1e-9)), 0.0)
    alike = alike * std[1:] * std[:-1] - np.sum(common[1:] * common[:-1], axis=1)
    alike = np.clip(alike / (rest[1:] * rest[:-1]), 0.0, MOST_ALIKE)
    times = np.zeros(len(t))
    lasting = alike > INDEPENDENT
    times[1:][lasting] = -step[lasting] / np.log(alike[lasting])
    return rest, times


def _edges(t: Array) -> Array:
    """Return the boundaries of the uninterrupted stretches of *t*, including both ends."""
    return np.concatenate([t[:1], t[gaps_in(t) + 1], [np.inf]])


def _joined(trial: Trial, drives: Sequence[Channel]) -> tuple[Array, Array, Array]:
    """Return the stamps (j,) at which any input changes, the inputs from then on (j, m), and the slack (j,).

    The slack is the possible error of a stamp; see :class:`.Segment`.
    """
    if not drives:
        return np.zeros(1), np.zeros((1, 0)), np.zeros(1)
    t = np.unique(np.concatenate([d.t for d in drives]))
    columns = [d.values[np.maximum(np.searchsorted(d.t, t, side="right") - 1, 0)] for d in drives]
    table = np.column_stack(columns)
    changes = np.concatenate([[True], np.any(np.diff(table, axis=0) != 0.0, axis=1)])
    slack = np.zeros(len(t))
    for drive in drives:
        changed = np.flatnonzero(np.diff(drive.values) != 0.0) + 1
        at = np.searchsorted(t, drive.t[changed])
        slack[at] = np.maximum(slack[at], _slack_of(trial, drive)[changed])
    return t[changes], np.ascontiguousarray(table[changes]), slack[changes]


def _dating_of(trial: Trial, drive: Channel) -> float:
    """Return the largest possible distance [s] between a jump of *drive* and its stamp.

    It is 0 for exact stamps. Otherwise the stamp lies midway between the last time without the jump and the first
    message with it. The last time without the jump is that of the message before, or one loop later if the autopilot's
    ``loop_period`` is known. An autopilot changes its outputs only at its own loop, and a relay switches in step with
    the telemetry. The error is therefore the same at every jump and does not average out.
    """
    if trial.meta.get("outputs_dated") != "midway":
        return 0.0
    jumps = np.flatnonzero(np.diff(drive.values) != 0.0) + 1
    if len(jumps) == 0:
        return 0.0
    loop = float(trial.meta.get("loop_period", 0.0))
    return max(float(np.median(drive.t[jumps] - drive.t[jumps - 1])) - loop, WITHIN_LOOP * loop)


def _slack_of(trial: Trial, drive: Channel) -> Array:
    """Return the possible error [s] of each stamp of *drive*.

    It is the shift of the stamp if the change happened in another loop of the autopilot.
    """
    slack = np.zeros(len(drive))
    loop = float(trial.meta.get("loop_period", 0.0))
    if trial.meta.get("outputs_dated") != "midway" or loop <= 0.0:
        return slack
    whole = np.round((np.diff(drive.t) - loop) / (0.5 * loop)) * 0.5 * loop
    slack[1:] = np.maximum(whole, 0.0)
    slack[gaps_in(drive.t) + 1] = 0.0  # what a gap hides is left out
    return slack
