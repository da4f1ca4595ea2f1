"""A proposed manoeuvre flown by the model: its inputs, its motion, and the record it would leave."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.record import Signal
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.limits.helm import Helm
from gcs_autotune.identify.limits.manoeuvres import Candidate, Shares
from gcs_autotune.identify.limits.reach import Reach, reach_of
from gcs_autotune.identify.limits.subject import Subject
from gcs_autotune.models.coupled import Simulator

__all__ = ["CONTROL_STEP", "Flight", "fly"]

Array = NDArray[np.float64]

CONTROL_STEP = 0.1
"""Seconds between two commands of a proposed manoeuvre."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """``t`` (j,) and ``inputs`` (j, m) as commanded, each held; ``record`` as it would be recorded, without noise."""

    t: Array
    inputs: Array
    record: CoupledRecord
    initial: Array
    reach: Reach

    def as_subject(self, subject: Subject) -> Subject:
        """Return *subject* on this flight alone."""
        return replace(subject, records=(self.record,), initial=(self.initial,))


def fly(subject: Subject, helm: Helm, candidate: Candidate, seconds: float) -> Flight | None:
    """Let the model fly *candidate*; None when it runs away.

    It starts from rest, or, when no input drives surge, at the median speed of the runs.
    """
    x_0 = _start(subject, helm)
    t: Array = np.arange(round(seconds / CONTROL_STEP), dtype=np.float64) * CONTROL_STEP
    inputs = _closed(subject, helm, candidate, t, x_0, seconds) if candidate.closed else _open(helm, candidate, seconds)
    if inputs is None:
        return None
    signals = {}
    for name, period in _periods(subject).items():
        own = np.arange(0.0, seconds, period)
        signals[name] = Signal(name, own, np.zeros(len(own)), 0.0)
    record = CoupledRecord(candidate.name, t, inputs, subject.records[0].input_units, signals)
    simulator = Simulator(subject.form)
    stamps = record.stamps
    found = simulator.run(subject.theta, x_0, t, inputs, stamps)
    if found is None:
        return None
    X, S = found
    for name, signal in signals.items():
        value = simulator.outputs(subject.theta, X, S, name)[0][np.searchsorted(stamps, signal.t)]
        signals[name] = replace(signal, values=value)
    return Flight(t, inputs, replace(record, signals=signals), x_0, reach_of(subject.form, stamps, X))


def _open(helm: Helm, candidate: Candidate, seconds: float) -> Array:
    return np.array([helm.inputs(shares) for shares in candidate.pilot(seconds, CONTROL_STEP)])


def _closed(subject: Subject, helm: Helm, candidate: Candidate, t: Array, x_0: Array, seconds: float) -> Array | None:
    simulator = Simulator(subject.form)
    states, x = simulator.states, x_0
    pilot = candidate.pilot(seconds, CONTROL_STEP)
    inputs = np.zeros((len(t), len(helm.channels)))
    shares: Shares = next(pilot)
    for i in range(len(t)):
        inputs[i] = helm.inputs(shares)
        if i + 1 == len(t):
            break
        found = simulator.run(subject.theta, x, t[: i + 1], inputs[: i + 1], t[i : i + 2])
        if found is None:
            return None
        x = found[0][-1]
        shares = pilot.send(dict(zip(states, x.tolist(), strict=True)))
    return inputs


def _start(subject: Subject, helm: Helm) -> Array:
    states = Simulator(subject.form).states
    x_0 = np.zeros(len(states))
    if "u" in states and "thrust" not in helm.columns:
        at = states.index("u")
        x_0[at] = float(np.median(np.concatenate([subject.motion(i)[1][:, at] for i in range(len(subject.records))])))
    return x_0


def _periods(subject: Subject) -> dict[str, float]:
    """Return the sampling period [s] of every signal, as in the runs."""
    steps: dict[str, list[float]] = {}
    for record in subject.records:
        for name, signal in record.signals.items():
            steps.setdefault(name, []).append(float(np.median(np.diff(signal.t))))
    return {name: float(np.median(own)) for name, own in steps.items()}
