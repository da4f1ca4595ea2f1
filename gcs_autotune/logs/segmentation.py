"""Segmentation of a recording into runs: one per segment armed in one mode, if driven and moving.

A quick assessment of each degree of freedom covers excitation, response and sampling. The identification itself
determines the information, with standard errors.
"""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.logs.channels import SERVOS, SHAFTS, drive_channels, filters_of, motion_channels
from gcs_autotune.logs.sample_store import Note, Recording, SampleStore
from gcs_autotune.rounding import counted
from gcs_autotune.sname import DOFS, Dof
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["Cut", "DofExcitation", "SkippedPart", "cut_runs", "excitation_of", "little_excitation", "runs_of"]

Array = NDArray[np.float64]

AXES = ("yaw", "surge", "sway", "heave")
SMALL_INPUT = 0.05
"""Smallest range of a useful input (normalised). Project choice."""
FEW_CHANGES = 4
"""Smallest number of input reversals that separate inertia from drag. Project choice."""
QUIET = 3.0
"""Ratio of a response's scatter to its noise below which the response counts as missing. Project choice."""
SLOW = 0.5
"""Sampling interval [s] above which the motion of a small craft is missed. Project choice."""
FEWEST = 20
"""Smallest number of samples required of a motion channel. Project choice."""
GOOD = "possibly usable"


@dataclass(frozen=True, slots=True)
class DofExcitation:
    """One degree of freedom of one run.

    Attributes
    ----------
    input_range : range from the 2nd to the 98th percentile, as a fraction of full output or in the input's unit.
    swings : number of times that the input went from the upper to the lower third of that range or back.
    response : name of the response channel. response_to_noise : its scatter divided by its short-time noise.
    input_interval, response_interval : median [s] between samples.
    verdict : ``possibly usable``, ``weak`` or ``nothing``. why : its reason.
    """

    dof: str
    input: str
    input_range: float
    swings: int
    response: str
    response_to_noise: float
    input_interval: float
    response_interval: float
    verdict: str
    why: str

    def to_dict(self) -> dict[str, Any]:
        """Return the assessment as plain data for JSON."""
        return asdict(self)


def excitation_of(run: Trial) -> list[DofExcitation]:
    """Return a quick assessment of each degree of freedom for which *run* has an input and a response."""
    found = (_look(run, DOFS[name]) for name in AXES)
    return [e for e in found if e is not None]


def little_excitation(looks: list[DofExcitation], name: str) -> Note | None:
    """Return the doubt about run *name*, of whose axes none is usable; None if one is usable, or there are none."""
    if not looks or any(e.verdict == GOOD for e in looks):
        return None
    return (
        "little-excitation",
        f"run '{name}' contains little information ({'; '.join(f'{e.dof}: {e.why}' for e in looks)})",
        "record a larger and longer relay, zig-zag or series of steps to both sides",
    )


def _look(run: Trial, dof: Dof) -> DofExcitation | None:
    names = [n for n in ((dof.force, "delta") if dof.name == "yaw" else (dof.force,)) if n in run]
    answers = [n for n in (dof.velocity, dof.position, *(("U",) if dof.name == "surge" else ())) if n in run]
    answers = [n for n in answers if len(run[n]) >= FEWEST]
    if not names or not answers or len(run[names[0]]) < 2:
        return None
    cause, effect = run[names[0]], run[answers[0]]
    low, high = np.percentile(cause.values, [2.0, 98.0])
    reversals = _reversals(cause.values, float(low), float(high))
    ratio = _to_noise(effect, is_angle=effect.unit == "rad")
    step, beat = _interval(cause), _interval(effect)
    reasons = [
        (high - low < SMALL_INPUT, "nothing", "the input hardly changes"),
        (ratio < QUIET, "nothing", f"the response varies by less than {QUIET:g} times its noise"),
        (reversals < FEW_CHANGES, "weak", f"the input reverses only {counted(reversals, 'time')}"),
        (max(step, beat) > SLOW, "weak", f"a sample every {max(step, beat):.2g} s is too slow for a small craft"),
    ]
    verdict, why = next(((v, w) for holds, v, w in reasons if holds), (GOOD, ""))
    return DofExcitation(
        dof.name, cause.name, float(high - low), reversals, effect.name, ratio, step, beat, verdict, why
    )  # fmt: skip


def _reversals(values: Array, low: float, high: float) -> int:
    third = (high - low) / 3.0
    if third <= 0.0:
        return 0
    side = np.where(values > high - third, 1, np.where(values < low + third, -1, 0))
    side = side[side != 0]
    return int(np.sum(side[1:] != side[:-1])) if len(side) else 0


def _to_noise(channel: Channel, *, is_angle: bool) -> float:
    values = np.unwrap(channel.values) if is_angle else channel.values
    noise = float(np.median(np.abs(np.diff(values, n=2)))) / (0.6745 * np.sqrt(6.0))
    steps = np.unique(np.abs(np.diff(values)))
    smallest = float(steps[steps > 0.0][0]) if np.any(steps > 0.0) else 0.0
    floor = max(noise, smallest / np.sqrt(12.0))
    return float(np.std(values)) / floor if floor > 0.0 else 0.0


def _interval(channel: Channel) -> float:
    steps = np.diff(channel.t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else float("inf")


SHORTEST = 5.0
"""Shortest segment [s] that counts as a manoeuvre. Project choice."""
SILENCE = 3.0
"""Longest silence [s] inside a run. Project choice."""
NO_INPUT = ("motion-only", "no-inputs")
"""Slugs of the notes about a missing input."""
FORCES = ("X", "Y", "Z", "K", "M", "N")


@dataclass(frozen=True, slots=True)
class _LogSegment:
    """A segment from ``start`` to ``end`` [s] in which the craft was armed in ``mode``."""

    start: float
    end: float
    mode: str


@dataclass(frozen=True, slots=True)
class SkippedPart:
    """A segment from which nothing can be identified, and the reason."""

    run: Trial
    why: str

    def __str__(self) -> str:
        return f"{self.run.name}: {self.why}"


@dataclass(frozen=True, slots=True)
class Cut:
    """Result of cutting a log: the ``runs``, and the segments left out with the reasons."""

    runs: list[Trial]
    left_out: list[SkippedPart]


def runs_of(log: Recording) -> list[Trial]:
    """Return the runs in a log, numbered in order of time, e.g. ``dive#3 MANUAL 120-185 s``.

    Raises
    ------
    NotInformative
        No segment is driven and moves; the message states the contents of the log.
    """
    cut = cut_runs(log)
    if not cut.runs:
        raise NotInformative(_nothing(log, cut.left_out))
    return cut.runs


def cut_runs(log: Recording) -> Cut:
    """Return the runs in a log and the segments left out. The log is cut at boots, silences, and every change of mode
    or armed state.
    """
    runs: list[Trial] = []
    dropped: list[SkippedPart] = []
    number = 0
    for store in log.stores:
        motion, sources = motion_channels(store)
        drive, origin, doubts = drive_channels(store)
        zero = store.span[0]
        for stretch in _stretches(store):
            number += 1
            name = f"{store.name}#{number} {stretch.mode} {stretch.start - zero:.0f}-{stretch.end - zero:.0f} s"
            channels = {n: _between(c, stretch.start, stretch.end) for n, c in {**motion, **drive}.items()}
            run = Trial(
                name,
                {n: c for n, c in channels.items() if len(c)},
                _marks(store, stretch),
                "imported",
                meta={
                    **log.meta,
                    "format": log.form,
                    "vehicle": store.vehicle,
                    "firmware": store.firmware.name if store.firmware else "unknown",
                    "mode": stretch.mode,
                    "stretch": number,
                    "clock": store.clock,
                    "late_samples": store.late,
                    "absurd_samples": store.absurd,
                    "dated_by_arrival": sorted(store.dated_by_arrival),
                    "input_from": origin,
                    "sources": sources,
                    "filters": filters_of(store.parameters, sources),
                    **({"outputs_dated": "midway"} if origin in (SERVOS, SHAFTS) else {}),
                    "notes": [*log.notes, *store.notes, *doubts],
                },
            )
            why = _useless(run, stretch, [*log.notes, *doubts])
            if why:
                dropped.append(SkippedPart(run, why))
            else:
                runs.append(_looked_at(run))
    words = [str(left) for left in dropped]
    return Cut([_with_dropped(run, words) for run in runs], dropped)


def _between(channel: Channel, start: float, end: float) -> Channel:
    """Return the samples with ``start <= t <= end`` without copying them."""
    first, last = np.searchsorted(channel.t, start, side="left"), np.searchsorted(channel.t, end, side="right")
    return Channel(channel.name, channel.unit, channel.t[first:last], channel.values[first:last])


def _looked_at(run: Trial) -> Trial:
    """Return a run with its quick assessment, and with a doubt if it contains little information."""
    looks = excitation_of(run)
    doubt = little_excitation(looks, run.name)
    notes = [*run.meta["notes"], *([doubt] if doubt else [])]
    return replace(run, meta={**run.meta, "excitation": [e.to_dict() for e in looks], "notes": notes})


def _with_dropped(run: Trial, dropped: list[str]) -> Trial:
    return replace(run, meta={**run.meta, "stretches_left_out": dropped})


def _stretches(store: SampleStore) -> list[_LogSegment]:
    """Cut at every change of mode or arming and around silences. Without any arming information it counts as armed."""
    start, end = store.span
    silent = store.silences(SILENCE)
    armed = store.arming or [(start, True)]
    modes = store.modes or [(start, -1)]
    cuts = sorted({min(max(t, start), end) for t, _ in (*armed, *modes)} | {end} | {t for gap in silent for t in gap})
    segments: list[_LogSegment] = []
    for a, b in itertools.pairwise(cuts):
        is_armed = _at(armed, a)
        if not is_armed or b <= a or (a, b) in silent:
            continue
        number = _at(modes, a)
        mode = "armed" if number is None or number < 0 else _mode_name(store, number)
        if segments and segments[-1].end == a and segments[-1].mode == mode:
            segments[-1] = _LogSegment(segments[-1].start, b, mode)
        else:
            segments.append(_LogSegment(a, b, mode))
    return segments


def _at(changes: list[tuple[float, Any]], t: float) -> Any:
    """Return the last entry at or before *t*; None before the first."""
    before = [value for moment, value in changes if moment <= t]
    return before[-1] if before else None


def _mode_name(store: SampleStore, number: int) -> str:
    return store.firmware.mode_name(number) if store.firmware else f"MODE {number}"


def _marks(store: SampleStore, stretch: _LogSegment) -> tuple[Mark, ...]:
    marks = [Mark(t, "mode", {"mode": _mode_name(store, n)}) for t, n in store.modes]
    marks += [Mark(t, "armed" if on else "disarmed") for t, on in store.arming]
    marks += [Mark(t, "text", {"text": text}) for t, text in store.texts]
    return tuple(sorted((m for m in marks if stretch.start <= m.t <= stretch.end), key=lambda m: m.t))


def _useless(run: Trial, stretch: _LogSegment, doubts: list[Note]) -> str:
    """Return why nothing can be identified from a run; empty if something may be."""
    if stretch.end - stretch.start < SHORTEST:
        return f"shorter than {SHORTEST:g} s"
    forces = [run[n] for n in FORCES if n in run]
    if not forces:
        return next((cause for slug, cause, _ in doubts if slug in NO_INPUT), "no input recorded")
    if not any(_varies(c) for c in forces):
        return "no actuator was driven"
    if not any(_varies(c) and len(c) >= FEWEST for n, c in run.channels.items() if n in _MOTION):
        return "nothing moves"
    return ""


_MOTION = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "U")


def _varies(channel: Channel) -> bool:
    return len(channel) > 1 and bool(np.ptp(channel.values) > 0.0)


def _nothing(log: Recording, dropped: list[SkippedPart]) -> str:
    stores = log.stores
    name = str(log.meta.get("source") or (stores[0].name if stores else "the log"))
    if not stores or all(t.span == (0.0, 0.0) for t in stores):
        return f"{name} contains no motion of a vehicle. Check that an autopilot was connected during the recording"
    long = sum(t.span[1] - t.span[0] for t in stores)
    if not dropped:
        return (
            f"{name} contains {long:.0f} s of {stores[0].vehicle}, but it was never armed, so nothing can be "
            "identified. Arm the vehicle, and record a relay, a zig-zag or steps"
        )
    notes = {cause: cure for left in dropped for slug, cause, cure in left.run.meta["notes"] if slug in NO_INPUT}
    whys = {left.why for left in dropped if not left.why.startswith("shorter")}
    if len(whys) == 1 and (cure := notes.get(*whys)):
        return f"{name} contains no segment to identify from: {whys.pop()}. {cure[0].upper()}{cure[1:]}"
    return (
        f"{name} contains no segment to identify from ({'; '.join(map(str, dropped[:6]))}). Record a relay or steps, "
        "with servo outputs and parameters in the log"
    )
