"""Measure the frequency response of a run from cross spectra, or at the harmonics of limit cycles.

The response is ``G = S_yu / S_uu``, with coherence ``|S_yu|^2 / (S_uu S_yy)`` (Bendat and Piersol, Random Data). The
spectra are averaged over sine tapers (Riedel1995) and over runs. The tapers cover the whole run, so the resolution of
slow motion is limited only by its length. A sweep need not be cut into pieces. The number of tapers grows with
frequency, where fine resolution is not needed.

A run of some tens of seconds hardly resolves a craft's corner frequency. Within one bandwidth the response bends, and
the motion at the start and end of the run leaks into other frequencies. Therefore a first-order model is fitted, and
its free run is subtracted from the motion. The response of the model is then added to that of the remaining motion
(prewhitening, Blackman1958). The result describes the record, whatever the model. Finite resolution affects only the
small remaining motion.

A settled relay experiment is periodic. At every odd harmonic the ratio of output to input is the response of the
process. For a linear process this is exact. The higher harmonics, which IS-O neglects, are used as data here.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.frequency.nomoto import fit_nomoto
from gcs_autotune.identify.frequency.response import FrequencyResponse, Sampled, mending, sampled, together, trusted
from gcs_autotune.identify.relay.limit_cycle import Settled, settled_cycles
from gcs_autotune.identify.signals.preparation import prepare
from gcs_autotune.identify.signals.segment import Segment, Signal
from gcs_autotune.models import Nomoto1, SingleDof
from gcs_autotune.sname import Dof
from gcs_autotune.trial import Trial

__all__ = ["HARMONICS", "STRONG", "TAPERS", "constant_force", "harmonic_response", "spectral_response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TAPERS = 4
"""Default number of tapers at low frequency.

It is the smallest from which a coherence can be calculated reliably. Project choice.
"""

MOST_TAPERS = 24

WIDTH = 0.5
"""Largest bandwidth of a spectral estimate, as a fraction of its frequency.

Half an octave resolves every corner frequency. Project choice.
"""

HIGHEST = 0.4
"""Highest frequency that is used, as a fraction of half the sampling rate.

Below it, the error of linear interpolation between samples is negligible. Project choice.
"""

ROUNDS = 3
"""Number of times that the first-order model is fitted and subtracted.

The third round changes a gain by less than its error. Project choice.
"""

STRONG = 1e-4
"""Smallest input power of the points to which the first-order model is fitted, relative to the strongest point.

Project choice.
"""


BLOCKS = 4
"""Number of pieces of each record in which the mean forces are balanced to estimate the constant force. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class _Spectra:
    """Sums of spectra over tapers and runs, (k,): input ``uu``, velocity ``yy``, cross spectrum ``yu``."""

    uu: Array
    yy: Array
    yu: Complex
    averages: Array


def spectral_response(trials: Trial | Sequence[Trial], dof: Dof | str, tapers: int = TAPERS) -> FrequencyResponse:
    """Return the response from input to velocity, at frequencies whose bands do not overlap.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        :func:`gcs_autotune.identify.signals.preparation.prepare` raised the error. NotInformative is also raised if the
        runs are too short for a single point.
    """
    runs = (trials,) if isinstance(trials, Trial) else tuple(trials)
    records = [record for trial in runs for record in prepare(trial, dof)]
    series = [sampled(record) for record in records]
    duration = max(run.duration for run in series)
    omega, count = _grid(duration, max(run.dt for run in series), tapers)
    if len(omega) == 0:
        raise NotInformative(
            f"a record of {duration:.3g} s is too short for a frequency response with {tapers} tapers. Record longer"
        )
    raw = _spectra(series, omega, count)
    response = _response(omega, raw, raw, np.zeros(len(omega)))
    for _ in range(ROUNDS):
        model = _model(response, records)
        if model is None:
            break
        try:
            left = _spectra([sampled(record, model) for record in records], omega, count)
        except NotInformative:
            break
        known = Nomoto1.from_single_dof(model).response(omega)
        response = _response(omega, left, raw, known)
    return response


def constant_force(records: Sequence[Segment], alpha: float, beta: float) -> tuple[float, float]:
    """Return the constant force of a linear model, and its standard error [both input unit].

    The constant force balances the mean inertial force (*alpha*), drag (*beta*) and input over each piece of a record.
    The standard error follows from the scatter of :data:`BLOCKS` pieces per record.
    """
    forces = []
    for run in (sampled(record) for record in records):
        edges = np.linspace(0, len(run.nu) - 1, BLOCKS + 1).astype(int)
        for i, j in itertools.pairwise(edges):
            gained = alpha * float(run.nu[j] - run.nu[i]) / ((j - i) * run.dt)
            drag = beta * float(0.5 * (run.nu[i:j] + run.nu[i + 1 : j + 1]).mean())
            given = float(0.5 * (run.tau[i:j] + run.tau[i + 1 : j + 1]).mean())
            forces.append(gained + drag - given)
    return float(np.mean(forces)), float(np.std(forces, ddof=1) / np.sqrt(len(forces)))


def _model(response: FrequencyResponse, records: Sequence[Segment]) -> SingleDof | None:
    """Return the first-order model fitted to *response*, or None if it cannot be simulated."""
    strong = response.at((response.input_power >= STRONG) & (response.coherence > 1.0 / response.averages))
    try:
        beta, alpha, delay = (float(v) for v in fit_nomoto(strong, 1).physical)
    except NotInformative:
        return None
    if alpha == 0.0 or beta / alpha < 0.0:
        return None
    delta, _ = constant_force(records, alpha, beta)
    return SingleDof(records[0].dof.name, records[0].input_units[0], alpha, beta, delta=delta, delay=delay)


def _grid(duration: float, dt: float, tapers: int) -> tuple[Array, NDArray[np.int_]]:
    """Return frequencies that are one bandwidth apart, and the number of tapers at each.

    The bandwidth of k tapers is (k + 1)/duration Hz.
    """
    unit, highest = 2.0 * np.pi / duration, HIGHEST * np.pi / dt
    omega: list[float] = []
    count: list[int] = []
    low = 0.5 * unit
    while True:
        k = int(np.clip(WIDTH * (low / unit) - 1.0, tapers, MOST_TAPERS))
        middle = low + 0.5 * (k + 1) * unit
        if middle > highest:
            return np.array(omega), np.array(count, dtype=np.int_)
        omega.append(middle)
        count.append(k)
        low += (k + 1) * unit


def _spectra(runs: Sequence[Sampled], omega: Array, count: NDArray[np.int_]) -> _Spectra:
    uu, yy, averages = np.zeros(len(omega)), np.zeros(len(omega)), np.zeros(len(omega))
    yu = np.zeros(len(omega), dtype=np.complex128)
    for run in runs:
        for k in np.unique(count):
            at = count == k
            U, Y = _transforms(run, omega[at], int(k))
            uu[at] += np.sum(np.abs(U) ** 2, axis=0)
            yy[at] += np.sum(np.abs(Y) ** 2, axis=0)
            yu[at] += np.sum(Y * np.conj(U), axis=0)
            averages[at] += int(k)
    return _Spectra(uu, yy, yu, averages)


def _transforms(run: Sampled, omega: Array, tapers: int) -> tuple[Complex, Complex]:
    """Return the tapered Fourier sums (tapers, k) of input and velocity after subtracting their means."""
    n = len(run.nu)
    steps = np.arange(n)
    taper = np.sin(np.pi * np.outer(np.arange(1, tapers + 1), steps + 1.0) / (n + 1.0)) * np.sqrt(2.0 / (n + 1.0))
    wave = np.exp(-1j * np.outer(steps * run.dt, omega))
    U: Complex = (taper * (run.tau - run.tau.mean())) @ wave
    Y: Complex = (taper * (run.nu - run.nu.mean())) @ wave * mending(omega, run.dt, run.derived)
    return U, Y


def _response(omega: Array, left: _Spectra, raw: _Spectra, known: Complex | Array) -> FrequencyResponse:
    """Return the response *known* of the model plus the response of the remaining motion *left*."""
    tiny = np.finfo(float).tiny
    value = known + left.yu / np.maximum(left.uu, tiny)
    noise = np.maximum(left.yy - np.abs(left.yu) ** 2 / np.maximum(left.uu, tiny), 0.0)
    coherence = np.clip(1.0 - noise / np.maximum(raw.yy, tiny), 0.0, 1.0)
    std = np.sqrt(noise / np.maximum(left.averages - 1.0, 1.0) / np.maximum(left.uu, tiny) / 2.0)
    power = left.uu / left.averages
    return FrequencyResponse(
        omega=omega,
        value=np.asarray(value, dtype=np.complex128),
        std=np.maximum(std, 1e-6 * np.abs(value)),
        coherence=coherence,
        averages=left.averages,
        input_power=power / max(float(power.max()), tiny),
        source="spectrum",
    )


HARMONICS = (1, 3, 5)
"""Numbers of the harmonics that are used by default.

The power of the input falls as 1/h^2 with the number h of the harmonic, that of the position as 1/h^6. Project choice.
"""

FITTED = 9
"""Number of harmonics that are fitted to a period.

Higher harmonics then do not distort those that are used. Project choice.
"""


def harmonic_response(
    trials: Trial | Sequence[Trial], dof: Dof | str, harmonics: Sequence[int] = HARMONICS
) -> FrequencyResponse:
    """Return the response from input to velocity at the *harmonics* of every limit cycle in *trials*.

    Mean and standard deviation are calculated over the periods.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        :func:`gcs_autotune.identify.signals.preparation.prepare` raised the error. NotInformative is also raised if no
        limit cycle has two whole periods with enough samples in each.
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
            f"run '{runs[0].name}' contains no limit cycle of two whole periods. Harmonics need a settled relay "
            "oscillation. Use source='spectrum' for any other input"
        )
    return together(parts)


def _of_cycle(record: Segment, settled: Settled, harmonics: Sequence[int]) -> FrequencyResponse | None:
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
    """Return the response from the Fourier coefficients (periods, harmonics) of each period."""
    periods = len(U)
    tiny = np.finfo(float).tiny
    S_uu, S_yy = np.sum(np.abs(U) ** 2, axis=0), np.sum(np.abs(Y) ** 2, axis=0)
    S_yu = np.sum(Y * np.conj(U), axis=0)
    value = S_yu / np.maximum(S_uu, tiny)
    residual = np.sum(np.abs(Y - value * U) ** 2, axis=0) / (periods - 1)
    coherence = np.clip(np.abs(S_yu) ** 2 / np.maximum(S_uu * S_yy, tiny), 0.0, 1.0)
    std = np.sqrt(residual / np.maximum(S_uu, tiny) / 2.0)
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
    """Return the complex Fourier coefficients of one period, by least squares over its samples."""
    keep = (signal.t >= start) & (signal.t <= end)
    t, x = signal.t[keep] - start, signal.values[keep]
    fitted = min(FITTED, (len(t) - 2) // 2)
    if fitted < max(harmonics):
        return None
    phase = 2.0 * np.pi / (end - start) * np.outer(t, np.arange(1, fitted + 1))
    table = np.hstack([np.ones((len(t), 1)), np.cos(phase), np.sin(phase)])
    solution = np.linalg.lstsq(table, x, rcond=None)[0]
    at = np.asarray(harmonics)
    coefficients: Complex = solution[at] - 1j * solution[fitted + at]
    return coefficients


def _held_series(record: Segment, start: float, end: float, harmonics: Sequence[int]) -> Complex:
    """Return the complex Fourier coefficients of the held input over one period, by exact integration."""
    inside = (record.t_in > start) & (record.t_in < end)
    edges = np.concatenate([[start], record.t_in[inside], [end]])
    level = record.tau[np.maximum(np.searchsorted(record.t_in, edges[:-1], side="right") - 1, 0)]
    omega = 2.0 * np.pi / (end - start) * np.asarray(harmonics, dtype=np.float64)
    wave = np.exp(-1j * np.outer(omega, edges - start))
    coefficients: Complex = 2.0 / (end - start) * (wave[:, 1:] - wave[:, :-1]) @ level / (-1j * omega)
    return coefficients
