"""The closed heading loop as it is flown: natural frequency and damping from relays on its set-point.

Two relays of different size give (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1) from commanded heading to heading
(Miskovic2010, (6.49), (6.52)), here by two harmonics of each period instead of the first alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import (
    Doubt,
    Reading,
    harmonic_response,
    loop_cycles,
    loop_process,
    loop_trial,
)
from gcs_autotune.models import TransferFunction
from gcs_autotune.seatrials.criteria import Particulars, Sheet, judged, known
from gcs_autotune.trial import Channel, Trial

__all__ = ["closed_loop_sheet"]

Array = NDArray[np.float64]
NAN = math.nan
SATURATED, OFTEN = 0.98, 0.05
"""An output that counts as full, and the share of the time that makes the loop another one."""
WELL_DAMPED, POORLY_DAMPED = 0.5, 0.3
"""Chosen: damping ratios above which a loop overshoots by less than a sixth, and below which by more than a third."""


def closed_loop_sheet(run: Trial, ship: Particulars) -> Sheet:
    """Return the figures of the loop in a run of relays on its set-point.

    Raises
    ------
    NotInformative
        Too few relays that settled, or a loop that is none.
    """
    parts = relays_of(run)
    notes: list[Doubt] = []
    loop = _loop(parts)
    omega_n, zeta = oscillation_of(loop)
    if "N" in run:
        full = float(np.mean(np.abs(np.concatenate([p["N"].values for p in parts])) >= SATURATED))
        if full > OFTEN:
            cause = f"the steering was at its limit for {100.0 * full:.0f} % of the time: the loop was not linear"
            notes.append(Doubt("saturated", cause, "give smaller --set-point and --second-set-point"))
    cycles = [cycle for part in parts for cycle in loop_cycles(part)]
    figures = known(
        judged("natural-frequency", "natural frequency of the closed loop", Reading(omega_n, NAN, "1/s")),
        judged("damping", "damping ratio", Reading(zeta, NAN)),
        judged("overshoot", "overshoot of a step, of its size", Reading(_overshoot(loop), NAN)),
        judged("a1", "a_1", Reading(loop.denominator[1], NAN, "s")),
        judged("a2", "a_2", Reading(loop.denominator[2], NAN, "s^2")),
        judged("a3", "a_3", Reading(loop.denominator[3] if len(loop.denominator) > 3 else NAN, NAN, "s^3")),
        judged("b1", "b_1", Reading(loop.numerator[1], NAN, "s")),
        *(
            figure
            for k, cycle in enumerate(cycles, start=1)
            for figure in (
                judged(f"omega-{k}", f"frequency of relay {k}", Reading(cycle.omega, NAN, "1/s")),
                judged(f"amplitude-{k}", f"amplitude of relay {k}", Reading(cycle.X_m, NAN, "rad")),
            )
        ),
    )
    return Sheet(run.name, "set-point-relay", "closed heading loop", figures, _verdict(zeta), tuple(notes))


def _loop(parts: Sequence[Trial]) -> TransferFunction:
    """Return the loop with three poles and a zero, or with two where the third is too quick to be told.

    Raises
    ------
    NotInformative
        No cycle settled, or the loop found is not stable, though it was flown.
    """
    response = harmonic_response([loop_trial(part) for part in parts], "yaw", (1, 3))
    for poles in (3, 2):
        loop = loop_process(response, poles, 1, gain=1.0)
        if all(p.real < 0.0 for p in loop.poles()):
            return loop
    raise NotInformative(
        "the loop read off these relays is not stable, though it was flown: repeat them with clearly different "
        "--set-point and --second-set-point"
    )


def _verdict(zeta: float) -> str:
    if zeta < POORLY_DAMPED:
        return "the heading loop swings: it is time for gcs-autotune tune heading"
    if zeta < WELL_DAMPED:
        return "the heading loop is damped, but not well"
    return "the heading loop is well damped"


def relays_of(run: Trial) -> list[Trial]:
    """Return the relays in a run one by one, with the heading commanded as channel ``psi_ref`` [rad].

    Raises
    ------
    NotInformative
        There are fewer than two.
    """
    starts = [m.t for m in run.marks if m.kind == "relay"]
    if len(starts) < 2:
        raise NotInformative(f"run '{run.name}' holds {len(starts)} relays on the set-point; the loop takes two")
    late = run.meta.get("link_times", {}).get("loop", 0.0)
    parts = []
    for start, end in zip(starts, [*starts[1:], run.end], strict=True):
        part = run.between(start, end)
        switches = [m for m in run.marks if m.kind == "switch" and start <= m.t < end]
        t = np.array([m.t for m in switches]) + 0.5 * float(late)
        ref = Channel("psi_ref", "rad", t, np.array([float(m.detail["psi_ref"]) for m in switches]))
        begun = next(m for m in run.marks if m.kind == "relay" and m.t == start)
        parts.append(
            replace(
                part,
                channels={**part.channels, "psi_ref": ref},
                meta={**run.meta, "manoeuvre": "relay", "x_a": begun.detail["x_a"]},
            )
        )
    return parts


def oscillation_of(loop: TransferFunction) -> tuple[float, float]:
    """Return natural frequency [rad/s] and damping ratio of the slower pair of poles of a stable *loop*."""
    poles: Sequence[complex] = sorted(loop.poles(), key=abs)
    pairs = [p for p in poles if p.imag > 1e-9]
    if pairs:
        return float(abs(pairs[0])), float(-pairs[0].real / abs(pairs[0]))
    product, total = poles[0].real * poles[1].real, -(poles[0].real + poles[1].real)
    return math.sqrt(product), float(total / (2.0 * math.sqrt(product)))


def _overshoot(loop: TransferFunction) -> float:
    """Return by how much of a step the loop overshoots it, by partial fractions."""
    poles = loop.poles()
    s = poles.astype(np.complex128)
    top = np.polyval(list(reversed(loop.numerator)), s)
    slope = np.polyval(np.polyder(list(reversed(loop.denominator))), s)
    t = np.linspace(0.0, 30.0 / float(np.abs(poles).min()), 3000)
    step = 1.0 + np.real((top / (slope * s))[None, :] * np.exp(np.outer(t, s))).sum(axis=1)
    return max(float(step.max()) - 1.0, 0.0)
