"""Align a simulation's record with the measured one before any fit: clock, order, signs and units.

A wrong clock, sign or unit in the simulation's file would look like a wrong craft. Inputs come first, then outputs.

**By the commands.** If the commands of both files change alike (:mod:`.command_match`), they determine the clock (rate
and offset) exactly. They also determine the order, sign and unit of every input. The craft does not matter.

**By the motion.** Otherwise a simulation whose stamps are far from the run's (they start at 0) is assumed to start with
the run. An offset of the clock is then reported as a delay. For the clock rate, the measured motion is regressed on the
simulated one at many lags, before and after. The lags absorb gain, time constant and delay of both, which are constant
over the record. A fast clock remains, because its shift grows along the record. The residual is whitened by
autoregression, so that disturbances do not count too much. The shift is also estimated in pieces, and the scatter
between pieces gives the uncertainty of the rate.

**Signs and units of the motion.** The static gain of the same regression is checked signal by signal. It may be
negative, or that of degrees for radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from gcs_autotune.diagnose.command_line import Clock, MatchedCommand
from gcs_autotune.diagnose.command_match import CommandMatch, match_commands
from gcs_autotune.diagnose.excitation_check import COMMANDS
from gcs_autotune.diagnose.result import Number
from gcs_autotune.identify import Doubt
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["SimulationAlignment", "compared"]

Array = NDArray[np.float64]

MOTIONS = ("r", "psi", "u", "v", "w", "z", "p", "q", "phi", "theta")
POSITIONS = frozenset({"psi", "z", "phi", "theta"})
HEADING = "psi"

MOST_ROWS = 1000
"""Maximum number of samples of a signal that are compared; a longer record is thinned."""

LAGS = (*range(11), 13, 16, 20, 27, 36)
"""Lags of the regression, in samples before and after: dense at typical delays, long enough for a slow craft."""

MEMORY = 8
"""Order of the autoregression that whitens the residual."""

WIDEST, GRID, PIECES = 0.12, 97, 6
"""WIDEST: largest clock-rate error searched. GRID: number of steps. PIECES: number of pieces to estimate the shift."""

SURE = 5.0
"""Standard errors from which a clock or a sign counts as wrong; three signals of several runs are tested."""

MIN_GAIN = 25.0
"""Twice the log-likelihood that a corrected clock rate must also gain."""

SINGULAR = 1e-12
"""Relative singular value below which a direction of a regression is ignored."""

RATE = "simulation seconds per second of these runs"
"""Description of the clock rate in the report."""

LEAST_RATE = 0.002
"""Clock-rate error below which the clock is not corrected."""

SAME, MOSTLY = 0.02, 0.75
"""SAME: relative difference of equal command values. MOSTLY: least fraction of samples with equal values."""

LEAST_TIMES = 20.0
"""Static gain, or its inverse, above which a signal has another unit instead of another response."""

DEGREES = math.degrees(1.0)

UNITS = (DEGREES, 100.0, 1000.0, 400.0, 500.0)
"""Factors between units of an input: degrees, percent, thousandths, pulses [us] from neutral to full."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulationAlignment:
    """Simulations converted to the runs' clock, signs and units, with the corrected errors and the doubts."""

    simulations: tuple[Trial, ...]
    rows: tuple[Number, ...] = ()
    doubts: tuple[Doubt, ...] = ()


def compared(simulations: Sequence[Trial], runs: Sequence[Trial]) -> SimulationAlignment:
    """Return *simulations* with clock, signs and units corrected.

    There is one simulation per run, in the same order. If their commands equal the runs', they get the runs' own
    commands, because these have finer stamps.
    """
    laid = _by_commands(simulations, runs) or _by_motion(simulations, runs)
    placed, offsets, doubts = _shifted_to(laid, runs)
    named, inputs, more = _inputs_set_right(laid.matches, placed, runs)
    factors = _factors(named, runs)
    outputs = [_factor_row(name, "the value that these runs record", *factor) for name, factor in factors.items()]
    ready = [_divided(s, factors) for s in named]
    doubts = [*doubts, *more]
    driven = [_driven(s, r, doubts, m) for s, r, m in zip(ready, runs, laid.matches, strict=True)]
    return SimulationAlignment(tuple(driven), (*laid.rows, *offsets, *inputs, *outputs), tuple(doubts))


def _factor_row(name: str, of: str, factor: float, std: float) -> Number:
    what = "sign" if abs(factor) == 1.0 else "unit"
    return _row(f"{what} of {name}", "1", f"times {of}", factor, std, 1.0)


# -- the clock


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """Simulations with the match of their commands to their runs', and the corrections of the clock scale.

    ``begins`` [s]: offset of a simulation that is stamped elsewhere than its run; 0 if the two overlap.
    """

    simulations: Sequence[Trial]
    matches: Sequence[CommandMatch]
    begins: Sequence[float]
    rows: tuple[Number, ...] = ()


def _by_commands(simulations: Sequence[Trial], runs: Sequence[Trial]) -> _Laid | None:
    """Match the commands of simulations and runs; return None if no match determines the clock scale."""
    original = [match_commands(s, r) for s, r in zip(simulations, runs, strict=True)]
    known = {k: m.clock for k, m in enumerate(original) if m.clock is not None and m.clock.has_scale}
    if not known:
        return None
    weights = np.array([c.scale_std**-2.0 for c in known.values()])
    usual, std = float(np.average([c.scale for c in known.values()], weights=weights)), float(weights.sum() ** -0.5)
    scales = {f"clock scale of '{runs[k].name}'": (c.scale, c.scale_std) for k, c in known.items()}
    if all(abs(c.scale - usual) <= SURE * c.scale_std for c in known.values()):
        scales = {"clock scale": (usual, std)}
        known = {k: replace(c, scale=usual, scale_std=std) for k, c in known.items()}
    usual = usual if _is_off(usual, std) else 1.0
    rows = [_row(name, "1", RATE, *scale, 1.0) for name, scale in scales.items() if _is_off(*scale)]
    begins = [_begins_with(s, r) for s, r in zip(simulations, runs, strict=True)]
    placed, matches = list(simulations), list(original)
    for k, run in enumerate(runs):
        clock = known.get(k)
        if clock is None:
            placed[k] = _reclocked(_shifted(simulations[k], begins[k]), usual)
            matches[k] = match_commands(placed[k], run, steady=True)
        elif _is_off(clock.scale, clock.scale_std):
            matches[k] = replace(original[k], clock=clock)
        else:
            matches[k] = replace(original[k], clock=replace(clock, scale=1.0))
    return _Laid(placed, matches, begins, tuple(rows))


def _is_off(scale: float, std: float) -> bool:
    """Return whether a clock's rate is significantly wrong, and by enough to matter."""
    return abs(scale - 1.0) > max(SURE * std, LEAST_RATE)


def _by_motion(simulations: Sequence[Trial], runs: Sequence[Trial]) -> _Laid:
    """Shift simulations to the start of their runs and correct the clock rate by the motion in both."""
    begins = [_begins_with(s, r) for s, r in zip(simulations, runs, strict=True)]
    placed = [_shifted(s, by) for s, by in zip(simulations, begins, strict=True)]
    rate = _rate_of(placed, runs)
    if rate is not None:
        placed = [_reclocked(s, rate[0]) for s in placed]
    rows = () if rate is None else (_row("clock scale", "1", RATE, *rate, 1.0),)
    matches = [match_commands(s, r, steady=True) for s, r in zip(placed, runs, strict=True)]
    return _Laid(placed, matches, begins, rows)


def _shifted_to(laid: _Laid, runs: Sequence[Trial]) -> tuple[list[Trial], list[Number], list[Doubt]]:
    """Return simulations on the runs' clocks, the corrected offsets, and the doubts about the clocks."""
    placed: list[Trial] = []
    offsets: list[tuple[str, float, float]] = []
    doubts: list[Doubt] = []
    for simulation, run, match, begins in zip(laid.simulations, runs, laid.matches, laid.begins, strict=True):
        doubts += _doubts_of(match, run.name, holds_commands=any(n in simulation for n in COMMANDS))
        if begins:
            doubts.append(_elsewhere(run.name, begins, by_commands=match.clock is not None))
        if match.clock is None:
            placed.append(simulation)
            continue
        given, std = _offset_by(match.clock, simulation)
        off = abs(given) > SURE * std
        placed.append(_on(simulation, match.clock) if off or match.clock.scale != 1.0 else simulation)
        if off and not begins:
            offsets.append((run.name, given, std))
        if match.period and (off or begins):
            doubts.append(_ambiguous(run.name, match.period))
    return placed, _offsets(offsets), doubts


def _offset_by(clock: Clock, simulation: Trial) -> tuple[float, float]:
    """Return the offset [s] of a simulation's first stamp relative to its run's clock, with its standard error."""
    first = _reach(simulation)[0]
    given = first - float(clock.on_run(np.array([first]))[0])
    far = abs(first - clock.theirs) / clock.scale**2
    scale_std = clock.scale_std if clock.has_scale and clock.scale != 1.0 else 0.0
    return given, math.hypot(clock.shift_std / clock.scale, far * scale_std)


def _on(simulation: Trial, clock: Clock) -> Trial:
    channels = {n: replace(c, t=clock.on_run(c.t)) for n, c in simulation.channels.items()}
    return replace(simulation, channels=channels)


def _doubts_of(match: CommandMatch, run: str, *, holds_commands: bool) -> list[Doubt]:
    """Return doubts about the clock that matching the commands did not resolve."""
    doubts = []
    if match.kind == "constant" and holds_commands:
        cause = (
            f"the commands in the simulation of '{run}' change too rarely to be matched with those of the run. "
            "Clock, order, signs and units of the inputs were not checked"
        )
        cure = "use a run whose commands change often"
        doubts.append(Doubt("commands-constant", cause, cure))
    if match.kind == "repeating":
        cause = (
            f"the commands of '{run}' and of its simulation are both periodic, but differ in period or number. "
            "Possible causes are a wrong clock or a simulator with its own commands. The time stamps were left "
            "unchanged"
        )
        doubts.append(Doubt("commands-repeat", cause, "drive the simulator with all commands of the run"))
    if match.is_uneven:
        cause = (
            f"the clock in the simulation of '{run}' is uneven. Its commands are {match.scatter:.2g} s (rms) off "
            "those of the run"
        )
        cure = "write the simulator's own time into its file, or step it at the time stamps of the run"
        doubts.append(Doubt("clock-uneven", cause, cure))
    for name, clock in match.others:
        cause = (
            f"the changes of {name} in the simulation of '{run}' indicate a different clock from that of all inputs "
            f"together. They give a rate of {clock.scale:.4g} s per second of the run instead of "
            f"{_scale_of(match):.4g}, or a different offset"
        )
        doubts.append(Doubt("commands-disagree", cause, f"check how and when {name} is written to the file"))
    return doubts


def _scale_of(match: CommandMatch) -> float:
    return 1.0 if match.clock is None else match.clock.scale


def _ambiguous(run: str, period: float) -> Doubt:
    return Doubt(
        "clock-ambiguous",
        f"the commands of '{run}' repeat every {period:.4g} s, so the simulation matches equally well one period "
        "earlier or later. The match closest to its own time stamps was used",
        "compare a run whose commands do not repeat, or stamp both files with one clock",
    )


def _offsets(offsets: Sequence[tuple[str, float, float]]) -> list[Number]:
    """Return one row for all runs if their clocks have the same offset, otherwise one row for each run."""
    what = "the simulation's time stamps relative to those of these runs"
    weights = np.array([std**-2.0 for _, _, std in offsets])
    mean = float(np.average([o for _, o, _ in offsets], weights=weights)) if offsets else 0.0
    if len(offsets) > 1 and all(abs(o - mean) < 3.0 * std for _, o, std in offsets):
        return [_row("clock offset", "s", what, mean, min(std for _, _, std in offsets), 0.0)]
    return [_row(f"clock offset of '{name}'", "s", what, o, std, 0.0) for name, o, std in offsets]


def _elsewhere(name: str, by: float, *, by_commands: bool) -> Doubt:
    taken = "match the commands" if by_commands else "start with the run"
    way = "before" if by > 0.0 else "after"
    return Doubt(
        "simulation-elsewhere",
        f"the simulation of '{name}' is stamped {abs(by):.4g} s {way} the run. It was shifted to {taken}",
        "write the time stamps of the run into the simulator's file",
    )


def _row(name: str, unit: str, meaning: str, given: float, std: float, right: float) -> Number:
    return Number(name, unit, meaning, given, std, right, 0.0, (right, right), True)


# -- where the clock begins, and what drives it


def _begins_with(simulation: Trial, run: Trial) -> float:
    """Return the shift [s] that lets a simulation stamped elsewhere start with its run; 0 if both overlap."""
    theirs, ours = _reach(simulation), _reach(run)
    overlap = min(theirs[1], ours[1]) - max(theirs[0], ours[0])
    return ours[0] - theirs[0] if overlap < 0.5 * min(theirs[1] - theirs[0], ours[1] - ours[0]) else 0.0


def _driven(simulation: Trial, run: Trial, doubts: list[Doubt], match: CommandMatch) -> Trial:
    """Return a simulation with the inputs of its run, if it has the same or none.

    If its clock is uneven, it keeps its own commands, because these are aligned with its motion.
    """
    matched = {c.ours for c in match.channels}
    channels = dict(simulation.channels)
    for name in (n for n in run.channels if n not in SIGNALS or n in COMMANDS):
        own = simulation.channels.get(name)
        kept = match.kind == "repeating" or (match.is_uneven and name in matched)
        if own is None or not len(own) or (_same(own, run[name]) and not kept):
            channels[name] = run[name]
        elif name not in matched:
            doubts.append(
                Doubt(
                    "simulation-driven-otherwise",
                    f"{name} differs between run '{run.name}' and its simulation. The simulation was compared "
                    f"using its own {name}",
                    "drive the simulator with the commands of the run, in the same units",
                )
            )
    return replace(simulation, channels=channels)


def _same(own: Channel, other: Channel) -> bool:
    """Return whether both channels have the same values most of the time."""
    at = np.maximum(np.searchsorted(other.t, own.t, side="right") - 1, 0)
    span = max(float(np.ptp(other.values)), float(np.abs(other.values).max()), 1e-300)
    return float(np.mean(np.abs(own.values - other.values[at]) < SAME * span)) > MOSTLY


def _reach(trial: Trial) -> tuple[float, float]:
    stamps = [c.t[np.isfinite(c.t)] for c in trial.channels.values() if len(c)]
    whole = np.concatenate(stamps) if stamps else np.zeros(1)
    return float(whole.min()), float(whole.max())


def _shifted(trial: Trial, by: float) -> Trial:
    return replace(trial, channels={n: replace(c, t=c.t + by) for n, c in trial.channels.items()})


# -- inputs: order, signs, units


def _inputs_set_right(
    matches: Sequence[CommandMatch], simulations: Sequence[Trial], runs: Sequence[Trial]
) -> tuple[list[Trial], list[Number], list[Doubt]]:
    """Return simulations with the runs' input names, signs and units, the corrections, and the doubts."""
    factors: dict[str, float] = {}
    doubts: list[Doubt] = []
    ready = []
    for simulation, run, match in zip(simulations, runs, matches, strict=True):
        channels = dict(simulation.channels)
        moved = [c for c in match.channels if c.ours != c.theirs]
        for c in moved:
            channels.pop(c.theirs, None)
        for c in match.channels:
            own = simulation[c.theirs]
            times = _times(c, simulation, run)
            values = (own.values - c.zero) / c.factor if times and abs(times) != 1.0 else own.values * (times or 1.0)
            channels[c.ours] = replace(own, name=c.ours, values=values)
            if times not in (None, 1.0):
                factors.setdefault(c.ours, times)
            elif times is None:
                doubts.append(_scaled(c, run.name))
        if moved:
            doubts.append(_exchanged(moved, run.name))
        ready.append(replace(simulation, channels=channels))
    rows = [_factor_row(name, "these runs' command", factor, 0.0) for name, factor in factors.items()]
    return ready, rows, doubts


def _times(command: MatchedCommand, simulation: Trial, run: Trial) -> float | None:
    """Return 1, -1 or the unit factor by which a simulation's command differs; None if it is of no known unit."""
    size = abs(command.factor)
    if abs(size - 1.0) < SAME:
        return math.copysign(1.0, command.factor)
    pulses = [
        f"pulses-{n}" in {note[0] for note in t.meta.get("notes", ())}
        for n, t in ((command.theirs, simulation), (command.ours, run))
    ]
    known = any(abs(size / unit - 1.0) < SAME for one in UNITS for unit in (one, 1.0 / one))
    far = size > LEAST_TIMES or size < 1.0 / LEAST_TIMES
    return command.factor if known or far or pulses[0] != pulses[1] else None


def _scaled(command: MatchedCommand, run: str) -> Doubt:
    return Doubt(
        "command-scaled",
        f"{command.theirs} in the simulation of '{run}' changes {command.factor:.4g} times as much as {command.ours} "
        "of the run",
        "if the units differ, write the command in the unit of the run. The gain was compared for the command as it "
        "is in the file",
    )


def _exchanged(moved: Sequence[MatchedCommand], run: str) -> Doubt:
    pairs = ", ".join(f"simulation column {c.theirs} is {c.ours} of the run" for c in moved)
    return Doubt(
        "commands-exchanged",
        f"the inputs in the simulation of '{run}' are in another order ({pairs}). They were reordered",
        "swap the names of these columns, or the inputs in the simulator",
    )


# -- how fast it runs


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """One signal of one run, ``y`` (n,) at uniform stamps ``t``, and the simulation's ``x`` at ``t_sim``."""

    name: str
    t: Array
    y: Array
    t_sim: Array
    x: Array
    step: float

    def rows(self, scale: float) -> tuple[Array, Array, Array]:
        """Return changes (n,) of the measured signal, regressors (n, k), and time stamps (n,) [s].

        scale : clock rate of the simulation; both clocks agree at the first stamp.
        """
        at = self.t[0] + scale * (self.t - self.t[0])
        lags = np.array(sorted({k for lag in LAGS for k in (lag, -lag)}))
        table = np.interp(at - lags[:, None] * self.step, self.t_sim, self.x)
        return np.diff(self.y), np.diff(table).T, 0.5 * (self.t[1:] + self.t[:-1])


def _pairs(simulations: Sequence[Trial], runs: Sequence[Trial], names: Sequence[str]) -> list[_Pair]:
    pairs = []
    for simulation, run in zip(simulations, runs, strict=True):
        for name in names:
            pair = _pair(simulation, run, name)
            if pair is not None:
                pairs.append(pair)
    return pairs


def _pair(simulation: Trial, run: Trial, name: str) -> _Pair | None:
    if name not in simulation or name not in run:
        return None
    theirs, ours = _numbers(simulation[name]), _numbers(run[name])
    start, end = max(theirs.t[0], ours.t[0]), min(theirs.t[-1], ours.t[-1])
    inside = int(np.sum((ours.t >= start) & (ours.t <= end)))
    if inside < 8 * len(LAGS) or np.ptp(theirs.values) == 0.0 or np.ptp(ours.values) == 0.0:
        return None
    n = min(inside, MOST_ROWS)
    t = np.linspace(start, end, n)
    y = np.interp(t, ours.t, ours.values)
    return _Pair(name, t, y, theirs.t, theirs.values, (end - start) / (n - 1))


def _numbers(channel: Channel) -> Channel:
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    values = channel.values[good]
    if channel.name == HEADING:
        values = np.unwrap(values)
    return replace(channel, t=channel.t[good], values=values)


def _rate_of(simulations: Sequence[Trial], runs: Sequence[Trial]) -> tuple[float, float] | None:
    """Return the seconds of the simulations per second of the runs, with standard error.

    Return None if the ratio does not differ significantly from 1.
    """
    pairs = _pairs(simulations, runs, _best_signals(simulations, runs))
    if not pairs:
        return None
    filters = [_whitening(p, 1.0) for p in pairs]

    def cost(scale: float) -> float:
        return sum(_cost_of(p, scale, f) for p, f in zip(pairs, filters, strict=True))

    grid = 1.0 + np.linspace(-WIDEST, WIDEST, GRID)
    before = cost(1.0)
    best = min(grid.tolist(), key=cost)
    filters = [_whitening(p, best) for p in pairs]
    for width in np.geomspace(0.5 * float(grid[1] - grid[0]), 2e-5, 10).tolist():
        best = min((best - width, best, best + width), key=cost)
    gained = min(before, cost(1.0)) - cost(best)
    rest, std = _slope(pairs, best, filters)
    if gained < MIN_GAIN or abs(best - 1.0) < max(SURE * std, LEAST_RATE) or abs(rest) > SURE * std:
        return None
    return best, std


def _best_signals(simulations: Sequence[Trial], runs: Sequence[Trial]) -> list[str]:
    """Return one signal for each degree of freedom that both have: its velocity, otherwise its position."""
    both = {n for s, r in zip(simulations, runs, strict=True) for n in MOTIONS if n in s and n in r}
    speed = {dof.position: dof.velocity for dof in DOFS.values()}
    return [n for n in MOTIONS if n in both and speed.get(n) not in both]


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A whitened regression: cost, gains of the lags, their covariance, residual, regressors before whitening,
    stamps."""

    cost: float
    gains: Array
    covariance: Array
    residual: Array
    table: Array
    t: Array


def _whitening(pair: _Pair, scale: float) -> Array:
    """Return the filter (m + 1,) that whitens the residual of the regression."""
    return _autoregression(_regressed(pair, scale, np.ones(1)).residual)


def _whitened(pair: _Pair, scale: float, filt: Array) -> tuple[Array, Array, Array, Array]:
    """Return whitened changes, whitened regressors (with one for a trend), regressors before whitening, and stamps."""
    y, table, t = pair.rows(scale)
    table = np.column_stack([table, np.ones(len(y))])
    return _filtered(y, filt), _filtered(table, filt), table, t


def _cost_of(pair: _Pair, scale: float, filt: Array) -> float:
    """Return the cost of :func:`_regressed` alone, by Cholesky decomposition.

    It is faster than the full regression; a search over clock rates needs a hundred costs.
    """
    y_w, table_w, *_ = _whitened(pair, scale, filt)
    square = table_w.T @ table_w
    square[np.diag_indices_from(square)] += SINGULAR * np.trace(square)
    try:
        left = y_w - table_w @ cho_solve(cho_factor(square), table_w.T @ y_w)
    except np.linalg.LinAlgError:  # nothing moves at all
        return _regressed(pair, scale, filt).cost
    return len(left) * math.log(max(float(left @ left) / max(len(left) - len(square), 1), 1e-300))


def _regressed(pair: _Pair, scale: float, filt: Array) -> _Fit:
    y_w, table_w, table, t = _whitened(pair, scale, filt)
    inverse = np.asarray(np.linalg.pinv(table_w.T @ table_w, rcond=SINGULAR, hermitian=True), dtype=np.float64)
    gains = inverse @ (table_w.T @ y_w)
    left = y_w - table_w @ gains
    square = max(float(left @ left) / max(len(left) - len(gains), 1), 1e-300)
    return _Fit(len(left) * math.log(square), gains, square * inverse, left, table, t[len(filt) - 1 :])


def _filtered(x: Array, filt: Array) -> Array:
    m = len(filt) - 1
    total: Array = np.zeros_like(x[m:])
    for k, f in enumerate(filt.tolist()):
        total += f * x[m - k : len(x) - k]
    return total


def _autoregression(e: Array) -> Array:
    """Return the filter (m + 1,) that whitens a series (Yule-Walker equations)."""
    n = len(e)
    e = e - e.mean()
    r = np.array([float(e[: n - k] @ e[k:]) for k in range(MEMORY + 1)])
    if r[0] <= 0.0:
        r[0] = 1.0
    at = np.abs(np.subtract.outer(np.arange(MEMORY), np.arange(MEMORY)))
    system = r[at] + 1e-6 * r[0] * np.eye(MEMORY)
    whitener: Array = np.concatenate([[1.0], -np.linalg.solve(system, r[1:])])
    return whitener


def _slope(pairs: Sequence[_Pair], scale: float, filters: Sequence[Array]) -> tuple[float, float]:
    """Return the remaining error of the clock rate and its standard error, from shifts of pieces of every record."""
    shifts, weights, times, owners = [], [], [], []
    for k, pair in enumerate(pairs):
        fit = _regressed(pair, scale, filters[k])
        moved = _filtered(np.gradient(fit.table @ fit.gains, pair.step), filters[k])
        for part in np.array_split(np.arange(len(fit.t)), PIECES):
            g, e = moved[part], fit.residual[part]
            power = float(g @ g)
            if power > 0.0:
                shifts.append(float(g @ e) / power)
                weights.append(power / max(float(np.var(fit.residual)), 1e-300))
                times.append(float(fit.t[part].mean()))
                owners.append(k)
    w, d, t = np.sqrt(np.array(weights)), np.array(shifts), np.array(times)
    which = np.array(owners)
    level = np.column_stack([(which == k).astype(float) for k in range(len(pairs))])
    slope = t - np.array([pairs[k].t.mean() for k in owners])
    table = np.column_stack([slope, level])
    solution = np.linalg.lstsq(w[:, None] * table, w * d, rcond=None)[0]
    left = w * (d - table @ solution)
    freedom = max(len(d) - table.shape[1], 1)
    raised = max(1.0, float(left @ left) / freedom)
    variance = raised * float(np.linalg.pinv((w[:, None] * table).T @ (w[:, None] * table))[0, 0])
    return float(solution[0]), math.sqrt(max(variance, 0.0))


def _reclocked(trial: Trial, scale: float) -> Trial:
    """Return a record with its time scale divided by *scale*, about its first stamp."""
    start = _reach(trial)[0]
    return replace(trial, channels={n: replace(c, t=start + (c.t - start) / scale) for n, c in trial.channels.items()})


# -- signs and units


def _factors(simulations: Sequence[Trial], runs: Sequence[Trial]) -> dict[str, tuple[float, float]]:
    """Return for each signal the factor between simulation and run, if it indicates a wrong sign or unit."""
    factors: dict[str, tuple[float, float]] = {}
    for name in MOTIONS:
        pairs = _pairs(simulations, runs, [name])
        if not pairs:
            continue
        gains, weights = [], []
        for pair in pairs:
            fit = _regressed(pair, 1.0, _whitening(pair, 1.0))
            own = fit.gains[:-1]
            variance = float(fit.covariance[:-1, :-1].sum())
            gains.append(float(own.sum()))
            weights.append(1.0 / max(variance, 1e-300))
        gain = float(np.average(gains, weights=weights))
        std = 1.0 / math.sqrt(sum(weights))
        if abs(gain) < SURE * std or gain == 0.0:
            continue
        times = 1.0 / gain
        unit = abs(times) > LEAST_TIMES or abs(times) < 1.0 / LEAST_TIMES
        degrees = SIGNALS[name][0].startswith("rad") and unit
        factor = math.copysign((DEGREES if abs(times) > 1.0 else 1.0 / DEGREES) if degrees else 1.0, times)
        if factor != 1.0:
            factors[name] = (factor, std / gain**2 if unit else 0.0)
    return factors


def _divided(trial: Trial, factors: Mapping[str, tuple[float, float]]) -> Trial:
    channels = {
        n: replace(c, values=c.values / factors[n][0]) if n in factors else c for n, c in trial.channels.items()
    }
    return replace(trial, channels=channels)
