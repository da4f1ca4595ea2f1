"""Prepare records for the filters and run one pass of a filter over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import spend
from gcs_autotune.identify.kalman.sweep import FilterHistory, backward, forward, new_history
from gcs_autotune.identify.kalman.waves import rough
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form, program_of, scratch, states_of

__all__ = ["FilterBank", "FilterRecord", "FilterResult", "Levels", "Prior", "Smoothed"]

Array = NDArray[np.float64]

LONGEST = 0.5
"""Longest interval [s] that a filter crosses in one step. A longer interval is divided by stamps without samples.

For craft with time constants above half a second, Simpson's rule for the process noise is then accurate to 1 %.
"""

HASTE = 1.5
"""Over-relaxation exponent for the intensities of the process noise. Project choice.

The iteration of the intensities converges slowly if process noise is weak.
"""

_CODES = ("u", "v", "w", "p", "q", "r", "x", "y", "z", "phi", "theta", "psi")


@dataclass(frozen=True, slots=True, eq=False)
class FilterRecord:
    """Data of one record for a filter.

    - ``record``: the segment, which contains the inputs.
    - ``stamps`` (s,): times of the samples [s].
    - ``Y`` (s, m): samples of every signal, NaN for a missing sample.
    """

    record: Segment
    stamps: Array
    Y: Array


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Noise levels of a filter.

    - ``noise`` (m,): noise variance of every signal.
    - ``drive`` (n,): intensity of the white noise that drives every state [unit^2/s].
    - ``walk`` (p,): intensity of the white noise that drives every free parameter [unit^2/s].
    - ``decay`` (p,) [1/s]: rate at which each parameter returns to zero; 0 or empty for constants. A decaying parameter
      is an Ornstein-Uhlenbeck process that restarts in every record; it models a drifting force.
    - ``waves`` (4,): parameters of the waves (see :mod:`.waves`), zeros for none. Waves restart in every record, appear
      in the first signal, and act as the first free parameter does.
    """

    noise: Array
    drive: Array
    walk: Array
    decay: Array = field(default_factory=lambda: np.zeros(0))
    waves: Array = field(default_factory=lambda: np.zeros(4))

    @property
    def of_waves(self) -> int:
        """Number of states for the waves: 2, or 0 without waves."""
        return 2 if rough(self.waves) else 0


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Assumptions before the first sample.

    - ``states`` (records, n): initial states of every record.
    - ``spread``: standard deviations of ``states``.
    - ``parameters`` (p,), ``covariance`` (p, p): free parameters and their covariance.
    """

    states: Array
    spread: Array
    parameters: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """Result of one pass over all records.

    - ``parameters`` (p,), ``covariance`` (p, p): free parameters after the last record.
    - ``histories``: details of the pass, one per record.
    """

    parameters: Array
    covariance: Array
    log_likelihood: float
    histories: tuple[FilterHistory, ...]

    @property
    def innovations(self) -> tuple[Array, Array]:
        """Innovations and their variances, each (stamps of all records, m). NaN where a sample is missing."""
        return np.vstack([t.e for t in self.histories]), np.vstack([t.S for t in self.histories])


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Result of the smoother for all records.

    - ``trajectories``, ``variances`` (s, N): smoothed states, free parameters and waves with their variances, per
      record.
    - ``by_noise`` (2, m), ``by_drive`` (2, n): score of the noise levels. A level maximises the likelihood if its two
      rows agree.
    """

    trajectories: tuple[Array, ...]
    variances: tuple[Array, ...]
    by_noise: Array
    by_drive: Array


class FilterBank:
    """A form and its records, prepared for filters.

    Parameters
    ----------
    free : names of the parameters carried in the filter's state; none for a filter with known parameters.
    per_run : each run has its own free parameters. They restart at the prior with every record of a new run.
    """

    def __init__(self, form: Form, records: Sequence[Segment], free: Sequence[str], *, per_run: bool = False) -> None:
        self.form = form
        self.program = program_of(form)
        self.states = states_of(form)
        self.signals = tuple(dict.fromkeys(n for r in records for n in r.signals))
        self.tracks = tuple(_track(r, self.signals) for r in records)
        self.free = tuple(free)
        runs = [r.run for r in records]
        self._anew = [per_run and i > 0 and runs[i] != runs[i - 1] for i in range(len(runs))]
        names, n = form.parameters, len(self.states)
        self.places = np.array([names.index(f) for f in self.free], dtype=np.int64)
        self._columns = np.array([n + self.free.index(x) if x in self.free else -1 for x in names], dtype=np.int64)
        self._codes = np.array([_CODES.index(x) for x in self.signals], dtype=np.int64)
        self._max_rates = [1.0] * len(self.tracks)
        self._needed = list(self._max_rates)

    def with_free(self, free: Sequence[str]) -> FilterBank:
        """Return a bank of the same records with the parameters *free* in the filter's state."""
        return FilterBank(self.form, [t.record for t in self.tracks], free)

    def ease(self) -> bool:
        """Reset the integration step to the one that the last pass needed, and return whether it changed.

        Passes that are compared must take the same steps, so the finest step so far applies to all later passes.
        Without this reset, a trial with almost no inertia would keep the steps a hundred times too fine.
        """
        finer = self._max_rates != self._needed
        self._max_rates = list(self._needed)
        return finer

    def afresh(self) -> None:
        """Reset the integration step to its initial value.

        An earlier trial may have required more steps than are allowed.
        """
        self._max_rates = [1.0] * len(self.tracks)
        self._needed = list(self._max_rates)

    def run(
        self,
        theta: Array,
        prior: Prior,
        levels: Levels,
        *,
        about: Sequence[Array] | None = None,
        sigma: bool = False,
        full: bool = False,
    ) -> FilterResult | None:
        """Filter all records in order; return None if the motion diverges.

        Parameters
        ----------
        theta : (all,) all parameters; values of free ones are used only with *about*.
        about : a trajectory (s, n) per record to linearise about, with the parameters of *theta*; None: linearise at
            the estimate.
        sigma : propagate mean and covariance by sigma points, which do not support waves.
        full : store the data that :meth:`smooth` needs.

        Raises
        ------
        OutOfTime
            The :class:`.Effort` is used up. Each state counts as much as a simulation.
        """
        n, p = len(self.states), len(self.free)
        N = n + p + levels.of_waves
        decay = levels.decay if len(levels.decay) else np.zeros(p)
        wanders = decay > 0.0
        parameters, covariance = prior.parameters.copy(), prior.covariance.copy()
        histories, total = [], 0.0
        for i, track in enumerate(self.tracks):
            if self._anew[i]:
                parameters, covariance = prior.parameters.copy(), prior.covariance.copy()
            if wanders.any():
                parameters[wanders] = 0.0
                covariance[wanders], covariance[:, wanders] = 0.0, 0.0
                covariance[wanders, wanders] = 0.5 * levels.walk[wanders] / decay[wanders]
            mean, cov = np.zeros(N), np.eye(N)
            mean[:n], mean[n : n + p] = prior.states[i], parameters
            cov[:n, :n], cov[n : n + p, n : n + p] = np.diag(prior.spread[i] ** 2), covariance
            spend(len(track.stamps) * N)
            history = new_history(len(track.stamps), len(self.signals), n, N, full=full)
            fastest = forward(
                self.program,
                np.asarray(theta, dtype=np.float64),
                self.places,
                self._columns,
                mean,
                cov,
                track.record.t_in,
                track.record.inputs,
                track.stamps,
                track.Y,
                self._codes,
                levels.noise,
                levels.drive,
                levels.walk,
                decay,
                levels.waves,
                np.zeros((0, n)) if about is None else np.ascontiguousarray(about[i][:, :n]),
                sigma,
                self._max_rates[i],
                history,
                scratch(n, N),
            )
            if fastest < 0.0:
                return None
            if wanders.any():
                self._needed[i] = max(float(2.0 ** np.ceil(np.log2(max(fastest, 1e-3)) + 0.2)), 1.0)
                self._max_rates[i] = max(self._max_rates[i], self._needed[i])
            seen = ~np.isnan(history.S)
            e, S = history.e[seen], history.S[seen]
            if not np.all(np.isfinite(e)) or not np.all(S > 0.0):
                return None
            total -= 0.5 * float(np.sum(e * e / S + np.log(2.0 * np.pi * S)))
            parameters, covariance = mean[n : n + p], cov[n : n + p, n : n + p].copy()
            histories.append(history)
        return FilterResult(parameters, covariance, total, tuple(histories))

    def smooth(self, result: FilterResult, levels: Levels) -> Smoothed:
        """Return the smoothed states and parameters of a full pass, by running backwards over the records."""
        n, p, m = len(self.states), len(self.free), len(self.signals)
        N = n + p + levels.of_waves
        decay = levels.decay if len(levels.decay) else np.zeros(p)
        anew = np.ones(N, dtype=bool)  # of every record
        anew[n : n + p] = decay > 0.0
        adjoint, information = np.zeros(N), np.zeros((N, N))
        by_noise, by_drive = np.zeros((2, m)), np.zeros((2, n))
        trajectories: list[Array] = []
        variances: list[Array] = []
        later_anew = False
        backwards = zip(reversed(self.tracks), reversed(result.histories), reversed(self._anew), strict=True)
        for track, history, run_anew in backwards:
            lost = np.full(N, True) if later_anew else anew
            adjoint[lost], information[lost], information[:, lost] = 0.0, 0.0, 0.0
            later_anew = run_anew
            path, var = np.empty((len(track.stamps), N)), np.empty((len(track.stamps), N))
            backward(
                track.stamps, levels.noise, decay, levels.waves, history, adjoint, information, path, var, by_noise,
                by_drive,
            )  # fmt: skip
            trajectories.insert(0, path)
            variances.insert(0, var)
        return Smoothed(tuple(trajectories), tuple(variances), by_noise, by_drive)


def _track(record: Segment, signals: Sequence[str]) -> FilterRecord:
    stamps = record.stamps
    holes = np.flatnonzero(np.diff(stamps) > LONGEST)
    between = [
        np.linspace(stamps[i], stamps[i + 1], int(np.ceil((stamps[i + 1] - stamps[i]) / LONGEST)) + 1)[1:-1]
        for i in holes
    ]
    stamps = np.unique(np.concatenate([stamps, *between]))
    Y = np.full((len(stamps), len(signals)), np.nan)
    for j, name in enumerate(signals):
        if name in record.signals:
            signal = record.signals[name]
            Y[np.searchsorted(stamps, signal.t), j] = signal.values
    return FilterRecord(record, stamps, Y)


def tuned(levels: Levels, smoothed: Smoothed, floors: Array, *, noise: bool = True, drive: bool = True) -> Levels:
    """Return noise levels that are closer to the maximum of the likelihood than *levels*.

    Each level is multiplied by the ratio of its two score rows. The score of a variance is half the difference of the
    rows (``backward``), so the maximum is a fixed point. A level keeps its value if the run contains no information on
    it.

    floors : (m,) smallest noise variances, from the resolution of the sensors.
    noise, drive : whether to update the variances of the signals, and the intensities of the process noise.
    """
    r, q = levels.noise.copy(), levels.drive.copy()
    if noise:
        a, b = smoothed.by_noise
        r = np.maximum(r * np.clip(np.where(b > 0.0, a / np.where(b > 0.0, b, 1.0), 1.0), 0.05, 20.0), floors)
    if drive:
        a, b = smoothed.by_drive
        q = q * np.clip(np.where(b > 0.0, a / np.where(b > 0.0, b, 1.0), 1.0), 0.02, 20.0) ** HASTE
    return replace(levels, noise=r, drive=q)
