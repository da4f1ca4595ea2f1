"""Waves: a narrow frequency band in the residual, and a test whether the residual contains one.

A predicting filter improves the likelihood for any coloured residual that a wrong model leaves. A band is therefore
accepted under these conditions:

- its damping ratio is below a quarter, and the run contains several periods;
- it is better than red noise, and the sensors' noise is visible;
- if a slowly varying force is present too, it is better than this force alone;
- it does not respond to the craft's own motion. It must not be proportional to the predicted motion, its rate, its
  square or its past, nor excited by it. With coefficients for every run, this motion must not explain more than the
  band does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from gcs_autotune.effects.effect import INPUT, Array, Effect, EffectCurve, EffectInstance, EffectResidual, Quantity
from gcs_autotune.effects.narrow_band import Oscillator, Record, cost, driven, whitened
from gcs_autotune.effects.summary import DataSummary
from gcs_autotune.sname import DOFS

__all__ = ["WaveDisturbance"]


NARROW, BROAD = 0.25, 0.7
"""Damping ratios of the models that are compared. Project choice.

- ``NARROW``: largest damping ratio of a band.
- ``BROAD``: damping ratio of a model without a peak, with which the band is compared.
"""
FEWEST = 40
"""Minimum number of samples of a run for the search for waves. Project choice."""
PERIODS = 5.0
"""Minimum number of periods of the band in the longest run. Project choice."""
FASTEST = 0.7
"""Highest frequency searched, relative to half the sampling rate. Project choice."""
BETTER = 10.0
"""Minimum reduction of minus twice the log-likelihood by a band, compared with red noise. Project choice."""
SLOW, DRIFT = (0.05, 0.1, 0.2, 0.3), 0.03
"""Constants for a slow force beside a band. Project choice.

- ``SLOW``: highest frequencies of the slow motion that are tried, relative to that of the band.
- ``DRIFT``: start value of its rms, relative to that of the wave force.
"""
SMOOTH = 0.005
"""Fraction of every signal's residual that the filter must leave. If it leaves less, the record was smoothed.

The next sample of a smoothed record follows from the last ones, whatever is wrong with the model. Project choice: a
ship in a basin left 0.001, and waves with sensor noise leave a tenth or more.
"""
PARTS, MEMORY = 8, 4
"""Delays at which the craft's own motion is compared with the band. Project choice.

- ``PARTS``: number of delays per period.
- ``MEMORY``: number of periods.
"""
OWN, CHANCE = 0.1, 2.0
"""Allowed gain of the craft's own motion over a band. Project choice.

- ``OWN``: gain as a fraction of the band's gain.
- ``CHANCE``: gain per regressor.
"""


@dataclass(frozen=True, slots=True)
class Band:
    """A narrow frequency band in the residuals.

    - ``omega`` [rad/s]: frequency.
    - ``zeta``: damping ratio.
    - ``laws``: signal -> model of the oscillation in it.
    - ``rms``: signal -> rms of the oscillation in it.
    - ``std``: standard errors of the logarithms of frequency, damping ratio, rms and ``drift``.
    - ``drift``: rms of the slow force over that of the wave force, 0 if there is no slow force.
    """

    omega: float
    zeta: float
    laws: Mapping[str, Oscillator]
    rms: Mapping[str, float]
    std: tuple[float, float, float, float]
    drift: float = 0.0


@dataclass(frozen=True, slots=True)
class _Kin:
    """Records of one signal, whether the signal is a velocity, and the craft's lag [s]."""

    records: Sequence[Record]
    rate: bool
    lag: float

    def law(self, omega: float, zeta: float, rho: float) -> Oscillator:
        """Return the model of the signal; the lag is limited to the range in which it matters."""
        return Oscillator(omega, zeta, min(max(self.lag, 0.02 / omega), 50.0 / omega), self.rate, rho)

    def cost(self, log_omega: float, log_zeta: float, log_rho: float, drift: float = 0.0) -> float:
        law = self.law(math.exp(log_omega), math.exp(log_zeta), math.exp(log_rho))
        return cost(law.drifting(drift) if drift else law, self.records)

    def slow(self, fade: float, size: float) -> Oscillator:
        """Return the model of a slow force without waves; *size* and *fade* as in :class:`.Oscillator`."""
        return Oscillator(fade, BROAD, min(max(self.lag, 0.02 / fade), 50.0 / fade), self.rate, 0.0, size, fade)

    def whitened(self, law: Oscillator) -> _Kin:
        """Return the one-step prediction errors of the records by the model *law*."""
        return replace(self, records=[(t, whitened(law, t, error[:, None])[0][:, 0]) for t, error in self.records])


def band_of(left: Sequence[EffectResidual], *, velocity: str, lag: float) -> Band | None:
    """Return the narrow frequency band in the residuals *left*, or None if there is none.

    left : residuals of the position and *velocity* of one degree of freedom.
    lag : time constant of the craft [s].
    """
    groups: dict[str, list[EffectResidual]] = {}
    for x in left:
        if len(x.error) >= FEWEST and float(np.ptp(x.error)) > 0.0:
            groups.setdefault(x.signal, []).append(x)
    kin = {s: _Kin([(x.t, x.error - np.mean(x.error)) for x in own], s == velocity, lag) for s, own in groups.items()}
    if not kin:
        return None
    every = [t for own in kin.values() for t, _ in own.records]
    longest, interval = (
        max(float(t[-1] - t[0]) for t in every),
        float(np.median(np.concatenate([*map(np.diff, every)]))),
    )
    low, high = 2.0 * math.pi * PERIODS / longest, FASTEST * math.pi / interval
    if low >= 0.5 * high:
        return None
    red = {s: _broad(own, low) for s, own in kin.items()}
    found = _alone(kin, red, low, high) or _with_drift(kin, red, low, high)
    if found is None:
        return None
    p, before = found
    omega, zeta, drift = math.exp(p[0]), math.exp(p[1]), _drift_of(p, kin)
    laws = {s: own.law(omega, zeta, math.exp(r)) for (s, own), r in zip(kin.items(), p[2:], strict=False)}
    laws = {s: law.drifting(drift) if drift else law for s, law in laws.items()}
    if max(_foreseen(law, kin[s].records) for s, law in laws.items()) < SMOOTH:
        return None
    gain = own = allowed = beyond = 0.0
    for s, law in laws.items():
        tables = _with_own_motion(law, kin[s].records, groups[s])
        more, regressors = _own_gain([np.concatenate(tables)])
        gain += before[s] - cost(law, kin[s].records)
        own += more
        allowed += CHANCE * regressors
        apart, regressors = _own_gain(tables)
        beyond += apart - regressors
    if own > max(OWN * gain, allowed) or beyond > gain:
        return None
    rms = {s: _rms_of_band(law, kin[s].records) for s, law in laws.items()}
    seconds = max(sum(float(t[-1] - t[0]) for t, _ in own.records) for own in kin.values())
    few = 0.5 / math.sqrt(max(seconds * zeta * omega, 1.0))
    of_omega, of_zeta, of_drift = _errors(kin, p)
    return Band(omega, zeta, laws, rms, (of_omega, of_zeta, few, of_drift), drift)


Accepted = tuple[Array, Mapping[str, float]]
"""Logarithms of omega, zeta, rho per signal, and of the drift if there is one, of an accepted band; the cost of every
signal without the band."""


def _alone(kin: Mapping[str, _Kin], red: Mapping[str, float], low: float, high: float) -> Accepted | None:
    """Return a band without a slow force, or None if it is not better than *red* noise."""
    starts = [np.array([math.log(omega), math.log(0.04), *([1.0] * len(kin))]) for omega in _peaks(kin, low, high)]
    p, value = _fitted(kin, low, high, starts)
    if not _is_narrow(p, low, high) or sum(red.values()) - value < BETTER:
        return None
    before = {s: cost(None, own.records) for s, own in kin.items()}
    beside = _drift_beside(kin, p, value, low, high)
    return p if beside is None else beside, before


def _drift_beside(kin: Mapping[str, _Kin], p: Array, value: float, low: float, high: float) -> Array | None:
    """Return the band *p* of cost *value*, fitted again with a slow force beside it; None if that is not better.

    It is fitted only if the band leaves an excess of slow motion, because the fit takes long.
    """
    laws = {s: own.law(*np.exp([p[0], p[1], r]).tolist()) for (s, own), r in zip(kin.items(), p[2:], strict=True)}
    left = {s: own.whitened(laws[s]) for s, own in kin.items()}
    if max(_slow_gain(left, edge * math.exp(p[0])) for edge in SLOW) < BETTER:
        return None
    both, other = _fitted(kin, low, high, [np.append(p, math.log(DRIFT))])
    return both if _is_narrow(both, low, high) and value - other > BETTER else None


def _with_drift(kin: Mapping[str, _Kin], red: Mapping[str, float], low: float, high: float) -> Accepted | None:
    """Return a band beside a slow force, or None if it is not better than *red* noise, or red noise beside that
    force."""
    if sum(cost(None, own.records) for own in kin.values()) - sum(red.values()) < BETTER:
        return None  # nothing varies slowly
    slow = {s: _slow(own, low, high) for s, own in kin.items()}
    left = {s: own.whitened(slow[s]) for s, own in kin.items()}
    if _peak_gain(left, low, high) < BETTER:
        return None
    rest = [math.log(0.1), *([1.0] * len(kin)), math.log(0.3)]
    starts = [np.array([math.log(omega), *rest]) for omega in _peaks(left, low, high)]
    p, value = _fitted(kin, low, high, starts)
    if not _is_narrow(p, low, high):
        return None
    before = {s: min(red[s], _peakless(own, slow[s], low, high)) for s, own in kin.items()}
    return (p, before) if sum(before.values()) - value > BETTER else None


def _is_narrow(p: Array, low: float, high: float) -> bool:
    return math.exp(p[1]) <= NARROW and 1.03 * low < math.exp(p[0]) < 0.97 * high


def _drift_of(p: Array, kin: Mapping[str, _Kin]) -> float:
    return math.exp(p[-1]) if len(p) > 2 + len(kin) else 0.0


def _total(p: Array, kin: Mapping[str, _Kin]) -> float:
    drift = _drift_of(p, kin)
    return sum(own.cost(p[0], p[1], r, drift) for r, own in zip(p[2:], kin.values(), strict=False))


def _fitted(kin: Mapping[str, _Kin], low: float, high: float, starts: Sequence[Array]) -> tuple[Array, float]:
    """Return log omega, log zeta, log rho per signal, and log drift if *starts* have it, of the best fit and its
    cost."""
    span = [(math.log(low), math.log(high)), (math.log(5e-4), math.log(0.35)), *([(-6.0, 16.0)] * len(kin))]
    span += [(-6.0, 4.0)] * (len(starts[0]) - len(span))
    floor, ceiling = np.array([a for a, _ in span]), np.array([b for _, b in span])

    def bounded(p: Array) -> float:
        inside = np.clip(p, floor, ceiling)
        return _total(inside, kin) + 1e3 * float(np.sum((p - inside) ** 2))

    best: tuple[Array, float] | None = None
    for start in starts:
        steps = np.diag([0.05, 0.7, *([1.0] * (len(start) - 2))])
        found = minimize(
            bounded,
            start,
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([start, start + steps]),
                "xatol": 1e-3,
                "fatol": 0.02,
                "maxfev": 250 + 100 * (len(start) - 2 - len(kin)),
            },
        )
        if best is None or float(found.fun) < best[1]:
            best = np.clip(found.x, floor, ceiling), float(found.fun)
    assert best is not None
    return best


def _slow(own: _Kin, low: float, high: float) -> Oscillator:
    """Return the best model of a slow force without waves."""
    edges = np.array([[math.log(0.1 * low), math.log(high)], [-6.0, 16.0]])
    starts = [np.array([math.log(fade), 1.0]) for fade in (0.3 * low, 3.0 * low)]
    found, _ = _roughly(lambda p: cost(own.slow(*np.exp(p).tolist()), own.records), starts, edges, 80)
    fade, size = np.exp(found).tolist()
    return own.slow(fade, size)


def _peakless(own: _Kin, slow: Oscillator, low: float, high: float) -> float:
    """Return the cost of a slow force with an oscillator beside it that has too much damping for a peak."""

    def of(p: Array) -> float:
        omega, rho, fade, size = np.exp(p).tolist()
        return cost(replace(own.law(omega, BROAD, rho), slow=size, fade=fade), own.records)

    red, decay = [math.log(0.02 * low), math.log(high)], [math.log(0.1 * low), math.log(high)]
    edges = np.array([red, [-6.0, 16.0], decay, [-6.0, 16.0]])
    known = [math.log(slow.fade), math.log(slow.slow)]
    starts = [np.array([math.log(omega), 0.0, *known]) for omega in (low, 8.0 * low)]
    return min(cost(slow, own.records), _roughly(of, starts, edges, 150)[1])


def _roughly(of: Callable[[Array], float], starts: Sequence[Array], edges: Array, most: int) -> tuple[Array, float]:
    """Return the best point (k,) and value of *of* from several starts, with at most *most* evaluations each.

    edges (k, 2): range of each coordinate.
    """

    def bounded(p: Array) -> float:
        inside = np.clip(p, edges[:, 0], edges[:, 1])
        return of(inside) + 1e3 * float(np.sum((p - inside) ** 2))

    ends = [
        minimize(bounded, start, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 0.1, "maxfev": most})
        for start in starts
    ]
    best = min(ends, key=lambda end: float(end.fun))
    return np.clip(best.x, edges[:, 0], edges[:, 1]), float(best.fun)


def _peak_gain(white: Mapping[str, _Kin], low: float, high: float) -> float:
    """Return the largest gain from one level of the spectrum within a band of a third of an octave either side, and
    another outside.

    It is twice the log-likelihood ratio of the periodogram (Whittle1953), for records *white* without a band.
    """
    grid = np.exp(np.linspace(math.log(low), math.log(high), 100))
    gain = np.zeros(len(grid))
    for own in white.values():
        spectra = [_periodogram(t, e) for t, e in own.records]
        omega, power = (np.concatenate([s[k][1:] for s in spectra]) for k in (0, 1))
        order = np.argsort(omega)
        sums, count = np.r_[0.0, np.cumsum(power[order])], len(omega)
        first, last = (np.searchsorted(omega[order], grid * 2.0**edge) for edge in (-1.0 / 3.0, 1.0 / 3.0))
        inside, within = np.clip(last - first, 1, count - 1), sums[last] - sums[first]
        outside = count - inside
        peak, rest = np.maximum(within, 1e-300) / inside, np.maximum(sums[-1] - within, 1e-300) / outside
        levels = count * np.log(sums[-1] / count) - inside * np.log(peak) - outside * np.log(rest)
        gain += np.where(peak > rest, 2.0 * levels, 0.0)
    return float(np.max(gain))


def _slow_gain(white: Mapping[str, _Kin], edge: float) -> float:
    """Return the gain from one level of the spectrum below the frequency *edge* [rad/s], and a lower one above it.

    It is twice the log-likelihood ratio, as in :func:`_peak_gain`, for records *white* without a band.
    """
    gain = 0.0
    for own in white.values():
        spectra = [_periodogram(t, e) for t, e in own.records]
        omega, power = (np.concatenate([s[k][1:] for s in spectra]) for k in (0, 1))
        slow, fast = power[omega < edge], power[omega >= edge]
        if len(slow) and len(fast) and np.mean(slow) > np.mean(fast):
            logs = [len(part) * math.log(max(float(np.mean(part)), 1e-300)) for part in (power, slow, fast)]
            gain += 2.0 * (logs[0] - logs[1] - logs[2])
    return gain


def _peaks(kin: Mapping[str, _Kin], low: float, high: float) -> list[float]:
    """Return the frequencies [rad/s] of the highest peaks of the spectrum, and of the spectrum weighted against
    drift."""
    grid = np.exp(np.linspace(math.log(low), math.log(high), 400))
    power = np.zeros(len(grid))
    for own in kin.values():
        every = sum(float(e @ e) for _, e in own.records)
        for t, e in own.records:
            power += np.interp(grid, *_periodogram(t, e, np.hanning(len(t)), pad=4)) / every
    first = [float(grid[int(np.argmax(weight * power))]) for weight in (np.ones(len(grid)), grid)]
    return first if abs(first[1] / first[0] - 1.0) > 0.05 else first[:1]


def _periodogram(t: Array, e: Array, window: Array | float = 1.0, pad: int = 1) -> tuple[Array, Array]:
    """Return frequencies [rad/s] and periodogram of *e* (n,), times *window* (n,) and padded to *pad* times its length.

    Uneven stamps *t* (n,) are interpolated.
    """
    n, step = len(t), float(t[-1] - t[0]) / (len(t) - 1)
    even = np.interp(t[0] + step * np.arange(n), t, e) * window
    power: Array = np.abs(np.fft.rfft(even, pad * n)) ** 2
    return 2.0 * math.pi / (pad * n * step) * np.arange(len(power), dtype=np.float64), power


def _broad(own: _Kin, low: float) -> float:
    """Return the cost of red noise plus white noise: an oscillator with too much damping for a peak."""
    edges = np.array([[math.log(0.02 * low), math.log(100.0 * low)], [-6.0, 16.0]])
    starts = [np.array([math.log(omega), 1.0]) for omega in (low, 8.0 * low)]
    red = _roughly(lambda p: own.cost(p[0], math.log(BROAD), p[1]), starts, edges, 80)[1]
    return min(cost(None, own.records), red)


def _with_own_motion(law: Oscillator, records: Sequence[Record], own: Sequence[EffectResidual]) -> list[Array]:
    """Return for each run its residual (n,) and the regressors (n, k) from the craft's own motion, whitened by *law*,
    as one table (n, 1 + k)."""
    return [
        whitened(law, t, np.column_stack([error, _with_motion(law, x)]))[0]
        for (t, error), x in zip(records, own, strict=True)
    ]


def _own_gain(tables: Sequence[Array]) -> tuple[float, int]:
    """Return the gain from regressing on the craft's own motion in addition to the band, and the number of
    regressors.

    Each of *tables* (n, 1 + k) has its own coefficients. In one table of all runs, a response that is not a multiple
    of the motion cancels, for example that of an actuator at its limit in a strong run and in a weak one.
    """
    before = after = 0.0
    for white in tables:
        error, X = white[:, 0], white[:, 1:]
        rest = error - X @ np.linalg.lstsq(X, error, rcond=1e-10)[0]
        before, after = before + float(error @ error), after + float(rest @ rest)
    n, k = sum(map(len, tables)), sum(white.shape[1] - 1 for white in tables)
    return n * math.log(before / max(after, 1e-300)), k


def _foreseen(law: Oscillator, records: Sequence[Record]) -> float:
    """Return the rms of one-step prediction errors relative to that of the records."""
    white, every = _joined(law, records)
    return math.sqrt(float(np.mean(white**2)) / max(float(np.mean(every**2)), 1e-300))


def _joined(law: Oscillator, records: Sequence[Record]) -> tuple[Array, Array]:
    """Return the one-step prediction errors of all *records*, and the records themselves (n,)."""
    white = np.concatenate([whitened(law, t, e[:, None])[0][:, 0] for t, e in records])
    return white, np.concatenate([e for _, e in records])


def _with_motion(law: Oscillator, x: EffectResidual) -> Array:
    """Return regressors (n, k) from the craft's own motion.

    They are a constant, the predicted motion, its rate and signed square, and the oscillation that it excites in the
    band. The motion at delays of up to some periods is added, for any linear memory of that length.
    """
    motion = x.measured - x.error
    motion = motion - np.mean(motion)
    period = 2.0 * math.pi / law.omega
    before = [np.interp(x.t - k * period / PARTS, x.t, motion) for k in range(1, PARTS * MEMORY + 1)]
    columns = [motion, np.gradient(motion, x.t), np.abs(motion) * motion, *driven(law, x.t, motion), *before]
    sizes = [max(float(np.sqrt(np.mean(c**2))), 1e-300) for c in columns]
    return np.column_stack([np.ones(len(motion)), *(c / s for c, s in zip(columns, sizes, strict=True))])


def _rms_of_band(law: Oscillator, records: Sequence[Record]) -> float:
    """Return the rms of the oscillation: that of the records with the white noise subtracted.

    The model's own variance is less certain, because the band is narrow. It is used if there is a slow force too.
    """
    white, every = _joined(law, records)
    noise = float(np.mean(white**2))
    return math.sqrt(law.rho * noise if law.slow else max(float(np.mean(every**2)) - noise, 0.0))


def _errors(kin: Mapping[str, _Kin], p: Array) -> tuple[float, float, float]:
    """Return standard errors of log omega, log zeta and of the last number, from the curvature of the likelihood."""
    k, h = len(p), np.full(len(p), 0.05)
    h[0] = min(0.02, 0.3 * math.exp(p[1]))
    H = np.empty((k, k))
    f = {}
    for i in range(k):
        for j in range(i, k):
            for a in (-1, 1):
                for b in (-1, 1):
                    at = p.copy()
                    at[i] += a * h[i]
                    at[j] += b * h[j]
                    f[a, b] = _total(at, kin)
            H[i, j] = H[j, i] = (f[1, 1] - f[1, -1] - f[-1, 1] + f[-1, -1]) / (4.0 * h[i] * h[j])
    variances = np.diag(np.linalg.pinv(0.5 * H))
    found = [math.sqrt(v) if v > 0.0 else math.nan for v in variances]
    return found[0], found[1], found[-1]


class WaveDisturbance(Effect):
    """Effect: a narrow-band force on one degree of freedom, with rms ``amplitude``, ``frequency`` and damping
    ``bandwidth``; and ``drift``, the rms of the second-order force that varies slowly with the square of the envelope.

    No simulation predicts the phase of the force. The force is estimated from the residuals of position and velocity,
    and judged by predicting one sample ahead. A sea of many frequencies is one band. ``drift`` is estimated if a slow
    force beside the band is supported. Waves in yaw also move the track, which then follows the measured heading.

    The mean of the second-order force is not part of this effect. On one heading it enters the equation of motion as
    the constant force ``X_0`` does, whatever the speed. So no run distinguishes it from ``input-bias``, and on
    several headings it looks like ``wind-load``. In a long-crested sea, the square of the envelope has an exponential
    distribution. The mean is then as large as ``drift``, which a constant force of another origin is only by chance.

    The force follows from the motion with the base model's inertia and drag (``DataSummary.base``). Without these,
    ``amplitude`` is not calculated.
    """

    slug = "wave-disturbance"
    family = "environment"
    meaning = "waves: a force that oscillates at one frequency, independent of the craft's motion"
    plain = "Waves push your craft, but there are none in {simulation}."
    parameters = (
        Quantity("amplitude", INPUT, "rms of the force"),
        Quantity("frequency", "rad/s", "frequency of encounter"),
        Quantity("bandwidth", "1", "damping ratio: 0 is a pure tone, 0.2 an irregular sea"),
        Quantity("drift", INPUT, "rms of the slow second-order force; in long-crested waves, its mean too"),
    )
    shown_by = "one peak in the residual's spectrum, unrelated to the commands"
    mistaken_for = ("backlash", "measurement-delay", "tether-pull", "input-bias")
    separated_by = "a few minutes without command on each of two headings. Waves keep the craft oscillating"
    fixed = ("amplitude", "frequency", "bandwidth", "drift")

    def places(self, data: DataSummary) -> tuple[str, ...]:
        """Return the names of the degrees of freedom with a measured signal."""
        return tuple(d for d in data.form.dofs if {DOFS[d].position, DOFS[d].velocity} & set(data.signals))

    def starts(self, place: str, data: DataSummary) -> tuple[Mapping[str, float], ...]:
        """Return a start value of 0 for ``amplitude``; :meth:`learn` estimates the band."""
        amplitude = {} if _gains(place, data) is None else {"amplitude": 0.0}
        return ({**amplitude, "frequency": 6.0 / data.time_constant, "bandwidth": 0.05},)

    def bounds(self, place: str, data: DataSummary) -> Mapping[str, tuple[float, float]]:
        """Return the bounds of the parameters.

        The frequency is at most half the sampling rate, and the band is narrow.
        """
        amplitude = {} if _gains(place, data) is None else {"amplitude": (0.0, 10.0 * max(data.amplitude.values()))}
        return {**amplitude, "frequency": (0.0, math.pi / data.interval), "bandwidth": (0.0, NARROW)}

    def constants(self, place: str, data: DataSummary) -> Mapping[str, float]:
        """Return inertia and time constant of the base model, per unit of input, or only the time constant."""
        return _gains(place, data) or {"lag": data.time_constant}

    def learn(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> EffectInstance:
        """Return *effect* with the band estimated from the residuals *left*. The amplitude is 0 if there is no band."""
        dof, lag = DOFS[effect.place], effect.constants["lag"]
        mine = [x for x in left if x.signal in (dof.position, dof.velocity)]
        band = band_of(mine, velocity=dof.velocity, lag=lag)
        kept = {n: v for n, v in effect.constants.items() if n in ("inertia", "lag")}
        effect = replace(effect, values={n: v for n, v in effect.values.items() if n != "drift"})
        if band is None:
            silent = {"amplitude": 0.0} if "inertia" in kept else {}
            return replace(effect.with_values(silent), constants=kept)
        found = {"frequency": band.omega, "bandwidth": band.zeta}
        if "inertia" in kept:
            found["amplitude"] = _force(band, effect)
            found |= {"drift": band.drift * found["amplitude"]} if band.drift else {}
        ratios = {f"ratio {s}": law.rho for s, law in band.laws.items()}
        # The lag as it was used: a time constant far from the period makes no difference and is not taken at its word.
        used = {"filter": next(iter(band.laws.values())).lag}
        ratios |= {"drift ratio": band.drift} if band.drift else {}
        names = ("frequency", "bandwidth", "amplitude", "drift")
        errors = {f"std {n}": e for n, e in zip(names, band.std, strict=True)}
        return replace(effect.with_values(found), constants={**kept, **used, **ratios, **errors})

    def judge(self, effect: EffectInstance, left: EffectResidual, columns: Array) -> tuple[Array, Array, float]:
        """Return one-step prediction errors, their derivatives and a penalty.

        The errors are scaled to their stationary size.
        """
        rho = effect.constants.get(f"ratio {left.signal}", 0.0)
        if rho <= 0.0 or len(left.error) == 0:
            return left.error, columns, 0.0
        rate = left.signal == DOFS[effect.place].velocity
        law = Oscillator(effect["frequency"], effect["bandwidth"], effect.constants["filter"], rate, rho)
        law = law.drifting(effect.constants.get("drift ratio", 0.0))
        white, deviation = whitened(law, left.t, np.column_stack([left.error, columns]))
        settled = deviation[-1]
        white *= settled
        return white[:, 0], white[:, 1:], 2.0 * float(np.sum(np.log(deviation / settled)))

    def turns(self, effect: EffectInstance) -> bool:
        """Return whether there is a band in yaw. The track then follows the heading that the waves cause."""
        return effect.place == "yaw" and any(v > 0.0 for n, v in effect.constants.items() if n.startswith("ratio "))

    def uncertainty(self, effect: EffectInstance, left: Sequence[EffectResidual]) -> Mapping[str, float]:
        """Return name -> standard error, from the curvature of the likelihood.

        The error of the amplitude follows from the number of independent oscillations.
        """
        if "std frequency" not in effect.constants:
            return {}
        found = {n: effect[n] * effect.constants[f"std {n}"] for n in ("frequency", "bandwidth")}
        if "amplitude" in effect.values:
            relative = math.hypot(effect.constants["std amplitude"], effect.constants["std frequency"])
            found["amplitude"] = effect["amplitude"] * relative
            if "drift" in effect.values:
                found["drift"] = effect["drift"] * math.hypot(relative, effect.constants["std drift"])
        return found

    def curve(self, effect: EffectInstance, data: DataSummary) -> EffectCurve | None:
        """Return plot data: the spectrum of the force. It is None without a band."""
        omega, zeta, a = effect["frequency"], max(effect["bandwidth"], 0.002), effect.values.get("amplitude", 0.0)
        if a <= 0.0:
            return None
        x = np.linspace(0.0, 3.0 * omega, 901)
        y = a**2 * 4.0 * zeta * omega**3 / math.pi / ((omega**2 - x**2) ** 2 + (2.0 * zeta * omega * x) ** 2)
        unit = self.unit_of("amplitude", effect.place, data)
        return EffectCurve(
            x, y, "frequency [rad/s]", f"force spectrum [({unit})^2 s/rad]", "Spectrum of the disturbance"
        )

    def unit_of(self, name: str, place: str, data: DataSummary) -> str:
        """Return the unit of the parameter *name*.

        For ``amplitude`` and ``drift`` it is that of the force, or else that of the input.
        """
        if name not in ("amplitude", "drift"):
            return next(q.unit for q in self.parameters if q.name == name)
        return data.inputs.get(DOFS[place].force, next(iter(data.inputs.values()), "1"))


def _gains(place: str, data: DataSummary) -> dict[str, float] | None:
    """Return inertia and drag per unit of input; return None if the base model has no numbers yet."""
    dof, form = DOFS[place], data.form
    known = {**form.known, **data.base}
    body = {"yaw": "I_z", "roll": "I_x", "pitch": "I_y"}.get(place, "m")
    inertia = known.get(body, 0.0) - known.get(f"{dof.force}_{dof.velocity}dot", 0.0)
    if inertia == 0.0:
        return None
    gain = 1.0
    for pairs in form.inputs.values():
        for force, g in pairs:
            if force == dof.force and isinstance(g, str) and dof.force not in form.inputs:
                gain = known.get(g.lstrip("-"), 1.0)
    drag = -known.get(f"{dof.force}_{dof.velocity}", 0.0)
    return {"inertia": inertia / gain, "lag": inertia / drag if inertia * drag > 0.0 else 1e6}


def _force(band: Band, effect: EffectInstance) -> float:
    """Return the rms of the force [input unit] that causes the motion."""
    dof = DOFS[effect.place]
    signal = dof.velocity if dof.velocity in band.rms else dof.position
    law = band.laws[signal]
    if law.rate:
        speed = band.rms[signal] / math.sqrt(1.0 - law.share)
    else:
        speed = band.rms[signal] / math.sqrt(law.share) / law.lag
    return abs(effect.constants["inertia"]) * band.omega * speed
