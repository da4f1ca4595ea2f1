"""The empirical response at the harmonics of limit cycles.

A settled relay experiment is periodic: at every odd harmonic of it input and output stand in the ratio of the process'
response, exactly for a linear process. What IS-O leaves out as higher harmonics is measurement here.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.record import Record, Signal, prepare
from gcs_autotune.identify.frequency.response import FrequencyResponse, together
from gcs_autotune.identify.frequency.sampled import trusted
from gcs_autotune.identify.relay.cycle_reading import Settled, settled_cycles
from gcs_autotune.identify.relay.matrix_iso import process_from_response
from gcs_autotune.models.transfer_function import TransferFunction
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Trial

__all__ = ["HARMONICS", "harmonic_response", "loop_process"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = (1, 3, 5)
"""Those read. The input's power falls as 1/h^2, the position's as 1/h^6."""

FITTED = 9
"""Harmonics fitted to a period, so that the ones read are not mistaken for their neighbours."""


def harmonic_response(
    trials: Trial | Sequence[Trial], dof: Dof | str, harmonics: Sequence[int] = HARMONICS
) -> FrequencyResponse:
    """Return the response from input to velocity at *harmonics* of every limit cycle in *trials*.

    Mean and scatter are taken over the periods.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        As :func:`gcs_autotune.identify.axis.record.prepare`; NotInformative, too, when no limit cycle has two whole
        periods with enough samples in each.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    parts = [
        part
        for run in runs
        for record in prepare(run, dof)
        for settled in settled_cycles(run, record)
        if (part := _of_cycle(record, settled, harmonics)) is not None
    ]
    if not parts:
        raise NotInformative(
            f"no limit cycle with two whole periods is in run '{runs[0].name}': "
            "harmonics need a relay that has settled; use source='spectrum' for any other input"
        )
    return together(parts)


def loop_process(response: FrequencyResponse, n: int, m: int, *, gain: float | None = None) -> TransferFunction:
    """Return the process from input to *position* with *n* poles and *m* zeros, from harmonics of its velocity.

    The exact counterpart of ``identify_process`` where records and not only readings are at hand; for the closed
    heading loop n = 3, m = 1, gain = 1.

    Raises
    ------
    NotInformative
        Too few frequencies.
    """
    s = 1j * response.omega
    return process_from_response(response.omega, response.value / s, n, m, gain=gain, std=response.std / response.omega)


def _of_cycle(record: Record, settled: Settled, harmonics: Sequence[int]) -> FrequencyResponse | None:
    signal = trusted(record)
    U, Y = [], []
    for start, end in itertools.pairwise(settled.edges):
        output = _series(signal, float(start), float(end), harmonics)
        if output is None:
            continue
        U.append(_held_series(record, float(start), float(end), harmonics))
        Y.append(output)
    if len(U) < 2:
        return None
    omega = settled.cycle.omega * np.asarray(harmonics, dtype=np.float64)
    to_velocity = 1j * omega if signal is record.position else np.ones(len(omega))
    return _averaged(omega, np.array(U), np.array(Y) * to_velocity)


def _averaged(omega: Array, U: Complex, Y: Complex) -> FrequencyResponse:
    """Return the response of per-period coefficients (periods, harmonics)."""
    periods = len(U)
    tiny = np.finfo(float).tiny
    S_uu, S_yy = np.sum(np.abs(U) ** 2, axis=0), np.sum(np.abs(Y) ** 2, axis=0)
    S_yu = np.sum(Y * np.conj(U), axis=0)
    value = S_yu / np.maximum(S_uu, tiny)
    left = np.sum(np.abs(Y - value * U) ** 2, axis=0) / (periods - 1)
    coherence = np.clip(np.abs(S_yu) ** 2 / np.maximum(S_uu * S_yy, tiny), 0.0, 1.0)
    std = np.sqrt(left / np.maximum(S_uu, tiny) / 2.0)
    return FrequencyResponse(
        omega=omega,
        value=value,
        std=np.maximum(std, 1e-6 * np.abs(value)),
        coherence=coherence,
        averages=np.full(len(omega), float(periods)),
        input_power=S_uu / max(float(S_uu.max()), tiny),
        source="harmonics",
    )


def _series(signal: Signal, start: float, end: float, harmonics: Sequence[int]) -> Complex | None:
    """Return complex Fourier coefficients of one period by least squares over its samples, at their own stamps."""
    keep = (signal.t >= start) & (signal.t <= end)
    t, x = signal.t[keep] - start, signal.values[keep]
    fitted = min(FITTED, (len(t) - 2) // 2)
    if fitted < max(harmonics):
        return None
    phase = 2.0 * np.pi / (end - start) * np.outer(t, np.arange(1, fitted + 1))
    table = np.hstack([np.ones((len(t), 1)), np.cos(phase), np.sin(phase)])
    found = np.linalg.lstsq(table, x, rcond=None)[0]
    at = np.asarray(harmonics)
    coefficients: Complex = found[at] - 1j * found[fitted + at]
    return coefficients


def _held_series(record: Record, start: float, end: float, harmonics: Sequence[int]) -> Complex:
    """Return the same coefficients of the held input, by exact integration."""
    inside = (record.t_in > start) & (record.t_in < end)
    edges = np.concatenate([[start], record.t_in[inside], [end]])
    level = record.tau[np.maximum(np.searchsorted(record.t_in, edges[:-1], side="right") - 1, 0)]
    omega = 2.0 * np.pi / (end - start) * np.asarray(harmonics, dtype=np.float64)
    wave = np.exp(-1j * np.outer(omega, edges - start))
    coefficients: Complex = 2.0 / (end - start) * (wave[:, 1:] - wave[:, :-1]) @ level / (-1j * omega)
    return coefficients
