"""Natural frequency and damping of the flown heading, depth or speed loop, from relays on its set-point.

Two relays of different size determine the transfer function (b_1 s + 1)/(a_3 s^3 + a_2 s^2 + a_1 s + 1) from commanded
to actual heading, depth or speed (Miskovic2010, (6.49), (6.52)). The loop is fitted to the whole record, starting at
two harmonics of each period.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares

from gcs_autotune.axes import AxisKind, position_axis
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import Doubt
from gcs_autotune.identify.frequency import harmonic_response
from gcs_autotune.identify.open_loop import Reading
from gcs_autotune.identify.relay import loop_cycles, loop_process, loop_trial
from gcs_autotune.models import TransferFunction
from gcs_autotune.seatrials.criteria import Figure, Particulars, Sheet, judged, known
from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.sname import DOFS, SIGNALS
from gcs_autotune.trial import Channel, Trial

__all__ = ["closed_loop_sheet"]

Array = NDArray[np.float64]
NAN = math.nan
STEP = 0.05
"""Time step [s] of the simulation. Project choice: a loop closed through a link is far slower."""
LOST, NUDGE, SLOPE_STEP = 1e6, 1e-4, 1e-5
MOST_DELAY = 1.0
"""Largest delay [s] that is fitted. Project choice: a longer delay belongs to the loop itself.

A limit on the turn's acceleration looks like such a delay.
"""
FOLLOWED = 0.9
"""Least fraction of the motion that a linear loop must explain.

Project choice: without saturation it usually explains more.
"""
DISTINCT = 0.05
"""Relative difference between the fits of two relays above which a cause is reported. Project choice."""
SPAN = 1e3
"""Range of a coefficient, relative to the relay's frequency (to the power of the coefficient's order).

Project choice. A faster pole has no visible effect.
"""
SHORT, LONG = 40, 400
"""Maximum number of cost evaluations from each start, and for the best fit until convergence. Project choice.

A slow integral with a zero and a delay makes the cost nearly flat.
"""
SATURATED, OFTEN = 0.98, 0.05
"""Normalised output that counts as full, and the fraction of time at full output above which the loop counts as
nonlinear. Project choice.
"""
SLOWEST_RISE, SLOWEST_SETTLING = 2.0, 4.0
"""Rise and settling time of a step, in periods of the slower relay, above which the relays do not determine them.

Project choice. In some thirty rechecks of simulated craft the rise was 0.2 to 0.8 periods, or 2.4 to 7. A loop of first
order has 1.8.
"""
WELL_DAMPED, POORLY_DAMPED = 0.5, 0.3
"""Limits of the damping ratio for the verdict.

Above ``WELL_DAMPED`` a loop overshoots by less than a sixth, below ``POORLY_DAMPED`` by more than a third. Project
choice.
"""
LARGE_OVERSHOOT = 0.2
"""Overshoot of a step that counts as large.

Project choice: it exceeds a sixth by more than the scatter of the overshoot.
"""


def closed_loop_sheet(run: Trial, ship: Particulars) -> Sheet:
    """Return the sheet of figures of the closed loop, from a run of relays on its set-point.

    Raises
    ------
    NotInformative
        There are too few relays that settled, or no stable loop fits the run.
    """
    axis = _axis(run)
    alone = next((m for m in run.marks if m.kind == "oscillation"), None)
    if alone is not None:
        return _oscillates(run, axis, float(alone.detail["amplitude"]), float(alone.detail["period"]))
    parts = relays_of(run)
    force, unit = DOFS[axis.dof].force, parts[0][_commanded(run)].unit
    actuator = {"N": "steering", "X": "throttle"}.get(force, "thrust")
    notes: list[Doubt] = []
    loop, explained, (omega_std, zeta_std, overshoot_std) = _loop(run, parts)
    whole = explained[-1]
    outputs = np.concatenate([p[force].values for p in parts]) if force in run else np.zeros(1)
    full = float(np.mean(np.abs(outputs) >= SATURATED))
    is_saturated = full > OFTEN  # then no doubt may advise a larger relay
    if whole < FOLLOWED:
        notes.append(_not_linear(explained, is_saturated=is_saturated))
    omega_n, zeta, overshoot = _characteristics(loop).tolist()
    if is_saturated:
        cause = f"the {actuator} was at its limit for {100.0 * full:.0f} % of the time, so the loop was not linear"
        notes.append(Doubt("saturated", cause, "use a smaller --set-point and --second-set-point"))
    cycles = [cycle for part in parts for cycle in loop_cycles(part)]
    period = max(2.0 * math.pi / cycle.omega for cycle in cycles)
    step = _step_figures(loop, period)
    rise = next(figure.reading.value for figure in step if figure.slug == "rise")
    if rise > SLOWEST_RISE * period:
        notes.append(_slower_than_the_relays(rise, period, is_saturated=is_saturated))
        step, omega_n, zeta, overshoot = (), NAN, NAN, NAN
    if omega_std >= omega_n or zeta_std >= zeta:  # figures of unknown size are left out
        omega_n = omega_std = zeta = NAN
    figures = known(
        judged("natural-frequency", "natural frequency of the closed loop", Reading(omega_n, omega_std, "1/s")),
        judged("damping", "damping ratio", Reading(zeta, zeta_std)),
        judged("overshoot", "step overshoot", Reading(overshoot, overshoot_std)),
        *step,
        judged("explained", "fit of the closed-loop model", Reading(whole, NAN)),
        judged("a1", "a_1", Reading(loop.denominator[1], NAN, "s")),
        judged("a2", "a_2", Reading(loop.denominator[2], NAN, "s^2")),
        judged("a3", "a_3", Reading(loop.denominator[3], NAN, "s^3")),
        judged("delay", "delay of the response", Reading(loop.delay, NAN, "s")),
        judged("b1", "b_1", Reading(loop.numerator[1], NAN, "s")),
        *(
            figure
            for k, cycle in enumerate(cycles, start=1)
            for figure in (
                judged(f"omega-{k}", f"frequency of relay {k}", Reading(cycle.omega, NAN, "1/s")),
                judged(f"amplitude-{k}", f"amplitude of relay {k}", Reading(cycle.X_m, NAN, unit)),
            )
        ),
    )
    title, verdict = f"closed {axis.name} loop", _verdict((zeta, zeta_std), (overshoot, overshoot_std), axis.name)
    return Sheet(run.name, "set-point-relay", title, figures, verdict, tuple(notes))


def _oscillates(run: Trial, axis: AxisKind, amplitude: float, period: float) -> Sheet:
    """Return the sheet of a self-oscillating loop, which has no linear model."""
    unit = run[axis.stepped].unit
    figures = known(
        judged("oscillation", "oscillation at constant command", Reading(amplitude, NAN, unit)),
        judged("period", "period of this oscillation", Reading(period, NAN, "s")),
    )
    shown = f"{math.degrees(amplitude):.0f} deg" if axis.angular else f"{amplitude:.2g} {unit}"
    verdict = (
        f"the {axis.name} loop oscillates at constant command without decay, amplitude {shown}. "
        f"Lower its gains, or run gcs-autotune tune {axis.name}"
    )
    return Sheet(run.name, "set-point-relay", f"closed {axis.name} loop", figures, verdict, ())


def _slower_than_the_relays(rise: float, period: float, *, is_saturated: bool) -> Doubt:
    """Return the doubt about a model that rises far more slowly [s] than the longest relay *period* [s].

    The slow part belongs to the fit, because noise, a dead zone or a small drift leaves it undetermined.
    """
    cause = (
        f"the fitted loop takes {rise:.1f} s to rise, but the relays switched it back and forth every {period:.1f} s"
    )
    cure = "repeat in calmer water" + " or with a larger --set-point" * (not is_saturated)
    return Doubt("slower-than-relays", cause, cure)


def _not_linear(explained: Sequence[float], *, is_saturated: bool) -> Doubt:
    """Return the doubt about the fractions *explained* of the larger relay, the smaller one and both.

    Saturation distorts the larger motion; a dead zone, waves and sensor noise distort the smaller one.
    """
    larger, *_, smaller, whole = explained  # some fly more than two
    cause = f"a linear loop explains only {100.0 * whole:.0f} % of this motion"
    shares = f"({100.0 * larger:.0f} % of the larger relay's, {100.0 * smaller:.0f} % of the smaller one's)"
    if larger < smaller - DISTINCT:
        return Doubt("not-linear", f"{cause} {shares}, which indicates saturation", "use a smaller --set-point")
    if smaller < larger - DISTINCT and not is_saturated:
        cause = f"{cause} {shares}, which indicates a dead zone, waves or noise"
        return Doubt("not-linear", cause, "use a larger --set-point and --second-set-point")
    return Doubt(
        "not-linear",
        f"{cause}, for either relay. A rate limit, noise, waves or a loop of another structure can cause this"
        if not is_saturated
        else f"{cause} {shares}. The limit of the actuator can cause this, and so can a dead zone, waves or noise",
        "compare the result with a flown step",
    )


def _axis(run: Trial) -> AxisKind:
    """Return the axis of the loop under test."""
    return position_axis(str(run.meta.get("dof", "yaw")))


def _commanded(run: Trial) -> str:
    """Return the name of the channel with the commands."""
    return f"{_axis(run).stepped}_ref"


def _loop(run: Trial, parts: Sequence[Trial]) -> tuple[TransferFunction, list[float], Array]:
    """Return the loop with three poles and a zero, the explained fractions, and standard errors.

    The fractions are those of the motion in the larger relay, in the smaller one and in both. The standard errors are
    those of natural frequency [rad/s], damping ratio and overshoot. The fit to the record starts at the harmonics, and
    at a loop of second order as fast as the relay.

    Raises
    ------
    NotInformative
        No relay settled, or the identified loop is not stable although the flown one is.
    """
    commanded, signal, dof = _commanded(run), _axis(run).stepped, _axis(run).dof
    response = harmonic_response([loop_trial(part) for part in parts], dof, (1, 3))
    w = float(response.omega[0])
    starts = [np.array([1.2 / w, w**-2, 0.1 * w**-3, 0.0]), np.array([3.0 / w, 6.0 / w**2, 5.0 / w**3, 2.5 / w])]
    with suppress(NotInformative):
        loop = loop_process(response, 3, 1, gain=1.0)
        starts.append(np.array([*loop.denominator[1:], loop.numerator[1]]))
    with suppress(NotInformative):
        loop = loop_process(response, 2, 1, gain=1.0)
        starts.append(np.array([*loop.denominator[1:], 0.05 * abs(loop.denominator[2]) ** 1.5, loop.numerator[1]]))
    held = [(m.t, float(m.detail[commanded])) for m in run.marks if m.kind == "hold"]
    ref = np.concatenate([*(part[commanded].values for part in parts), [value for _, value in held]])
    at = np.concatenate([*(part[commanded].t for part in parts), [when for when, _ in held]])
    ref, at = ref[np.argsort(at, kind="stable")], np.sort(at)
    t = np.arange(at[0], at[-1], STEP)  # after the last switch that command is no longer held
    middle = 0.5 * float(parts[0][commanded].values.max() + parts[0][commanded].values.min())
    seen = run[signal]
    answer = np.interp(t, seen.t, seen.values) - middle
    jumps = np.abs(np.diff(ref, prepend=middle))
    jumps /= jumps.max()

    def left(theta: Array) -> Array:
        """Return the residual of the loop with the parameters *theta*.

        The command is averaged over each time step and shifted by the delay. A rate limit of the autopilot on its inner
        reference delays larger changes.
        """
        edges = np.append(np.maximum.accumulate(at + theta[4] + theta[5] * jumps), math.inf)
        edges[-1] = max(run.end, edges[-2]) + MOST_DELAY
        area = np.concatenate([[0.0], np.cumsum((ref - middle) * np.diff(edges))])
        command = np.diff(np.interp(np.append(t, t[-1] + STEP), edges, area)) / STEP
        return _left_of(np.exp(theta[:3]), theta[3], command, answer)

    def slopes(theta: Array) -> Array:
        """Return the derivatives of :func:`left` as difference quotients.

        The steps are far larger than the rounding error of :func:`left`, because slow poles lose half the digits.
        """
        here = left(theta)
        columns = []
        for i, size in enumerate(SLOPE_STEP * np.maximum(np.abs(theta), 1.0)):
            moved = theta.copy()
            moved[i] += size if theta[i] + size <= high[i] else -size
            columns.append((left(moved) - here) / (moved[i] - theta[i]))
        return np.column_stack(columns)

    pace = -np.log(w) * np.array([1.0, 2.0, 3.0])
    low = np.array([*(pace - math.log(SPAN)), -np.inf, 0.0, 0.0])
    high = np.array([*(pace + math.log(SPAN)), np.inf, MOST_DELAY, MOST_DELAY])
    fits = []
    for begin in starts:
        if np.all(begin[:3] > 0.0):
            x = np.clip([*np.log(begin[:3]), begin[3], 0.1, 0.05], low + NUDGE, high - NUDGE)
            fits.append(least_squares(left, x, slopes, bounds=(low, high), x_scale="jac", max_nfev=SHORT))
    best = min(fits, key=lambda fit: float(fit.cost))
    if (
        best.status == 0
    ):  # where it stopped in the valley hangs on the last bits of a processor; where that ends does not
        best = least_squares(left, best.x, slopes, bounds=(low, high), x_scale="jac", max_nfev=LONG)
    noise = float(run.meta.get("noise_std", 0.0)) ** 2  # of the sensor: no loop has to explain it
    loop = _of(best.x)
    if not all(p.real < 0.0 for p in loop.poles()):
        raise NotInformative(
            "the loop identified from these relays is unstable, although the flown one is stable. Repeat the relays "
            "with clearly different --set-point and --second-set-point"
        )
    explained = []
    for part in (*sorted(parts, key=lambda part: -float(np.ptp(part[commanded].values))), run):
        inside = (t >= part.start) & (t <= part.end)
        missed, moved = float(np.var(best.fun[inside])), float(np.var(answer[inside]))
        explained.append(1.0 - math.sqrt(max(missed - noise, 0.0) / max(moved - noise, 1e-12)))
    estimated = np.flatnonzero(best.active_mask == 0)
    return loop, explained, _errors(best.x, np.asarray(best.jac, dtype=np.float64), best.fun, estimated)


def _errors(theta: Array, J: Array, left: Array, estimated: NDArray[np.intp]) -> Array:
    """Return the standard errors of :func:`_characteristics`; the residuals may be correlated.

    estimated : indices of the identified numbers; one at its bound (a pole too fast to be visible) counts as known.
    """
    again = float(np.corrcoef(left[1:], left[:-1])[0, 1])
    variance = float(np.var(left)) * (1.0 + again) / max(1.0 - again, 1e-3)
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(estimated, estimated)] = variance * np.linalg.pinv(J[:, estimated].T @ J[:, estimated])
    here = _characteristics(_of(theta))
    slopes = np.zeros((len(here), len(theta)))
    for i in range(4):  # the delays move none of them
        moved = theta.copy()
        moved[i] += NUDGE
        slopes[:, i] = (_characteristics(_of(moved)) - here) / NUDGE
    return np.asarray(np.sqrt(np.diag(slopes @ covariance @ slopes.T)))


def _step_figures(loop: TransferFunction, period: float) -> tuple[Figure, ...]:
    """Return rise and settling time of a step of the *loop*, as measured in a tune.

    period : of the slower relay [s]. It does not determine a much longer settling time, which is left out.
    """
    t, x = _step_of(loop)
    reached = [float(t[int(np.argmax(x >= share))]) for share in (0.1, 0.9)]
    outside = np.flatnonzero(np.abs(x - 1.0) > SETTLED)
    settling = float(t[outside[-1]]) + loop.delay if len(outside) and outside[-1] + 1 < len(t) else NAN
    settling = NAN if settling > SLOWEST_SETTLING * period else settling
    rise = reached[1] - reached[0] if np.any(x >= 0.9) else NAN
    return (
        judged("rise", "rise time of a step (10 to 90 %)", Reading(rise, NAN, "s")),
        judged("settling", "settling time of a step (to within 5 %)", Reading(settling, NAN, "s")),
    )


SETTLED = 0.05
"""Deviation from the end value, relative to the step, within which a signal counts as settled. Project choice."""


def _characteristics(loop: TransferFunction) -> Array:
    """Return natural frequency, damping ratio and overshoot of a *loop*."""
    return np.array([*oscillation_of(loop), _overshoot(loop)])


def _of(theta: Array) -> TransferFunction:
    """Return the loop of the logarithms of a_1, a_2, a_3, then b_1, the delay, and the additional delay of large
    changes."""
    a_1, a_2, a_3 = np.exp(theta[:3]).tolist()
    return TransferFunction((1.0, float(theta[3])), (1.0, a_1, a_2, a_3), delay=float(theta[4] + theta[5]))


def _left_of(a: Array, b_1: float, command: Array, answer: Array) -> Array:
    """Return the residual of the loop: response *answer* (n,) to commands *command* (n,), each held for a step.

    The initial state is fitted, because earlier commands and the state of a slow integral are unknown.
    """
    A = np.zeros((4, 4))
    A[0, 1] = A[1, 2] = 1.0
    A[2] = np.array([-1.0, -a[0], -a[1], 1.0]) / a[2]
    stepped = expm(A * STEP)
    signal = scipy_signal()
    if not np.all(np.isfinite(stepped)):
        return np.full(len(command), LOST)
    C = np.array([[1.0, b_1, 0.0]])
    top, bottom = signal.ss2tf(stepped[:3, :3], stepped[:3, 3:], C, np.zeros((1, 1)))
    kick = np.zeros(len(command))
    kick[0] = 1.0
    first = np.array([(C @ np.linalg.matrix_power(stepped[:3, :3], k))[0] for k in range(3)])
    free_responses = [signal.lfilter(np.convolve(bottom, column)[:3], bottom, kick) for column in first.T]
    both = np.column_stack([signal.lfilter(top[0], bottom, command), *free_responses])
    flown, *free = np.clip(np.nan_to_num(both, nan=LOST), -LOST, LOST).T
    begins = np.column_stack(free) / np.linalg.norm(free, axis=1)
    left = flown - answer
    left -= begins @ np.linalg.lstsq(begins, left, rcond=1e-8)[0]
    return np.asarray(left)


def _verdict(damping: tuple[float, float], overshoot: tuple[float, float], axis: str) -> str:
    """Return the verdict on the loop of *axis* from damping ratio and overshoot, each with its standard error."""
    (zeta, std), (over, over_std) = damping, overshoot
    if zeta + std < POORLY_DAMPED:
        return f"the {axis} loop oscillates. Run gcs-autotune tune {axis}"
    if over - over_std > LARGE_OVERSHOOT:  # of an integral, beside poles that are damped well
        return f"the {axis} loop overshoots a step by {100.0 * over:.0f} %. Run gcs-autotune tune {axis}"
    if math.isnan(zeta):
        return f"these relays do not determine the damping of the {axis} loop. Try other relay sizes"
    if zeta - std > WELL_DAMPED:
        return f"the {axis} loop is well damped"
    if std < 0.5 * (WELL_DAMPED - POORLY_DAMPED):
        return f"the {axis} loop is moderately damped"
    return f"the damping of the {axis} loop is uncertain by +-{std:.1f}. Try other relay sizes"


def relays_of(run: Trial) -> list[Trial]:
    """Return one run per relay of *run*, with the command as the channel ``psi_ref`` [rad], ``z_ref`` or ``u_ref``.

    Raises
    ------
    NotInformative
        There are fewer than two relays.
    """
    starts = [m.t for m in run.marks if m.kind == "relay"]
    if len(starts) < 2:
        flown = f"{len(starts)} relay{'s' * (len(starts) != 1)}"
        raise NotInformative(f"run '{run.name}' has {flown} on the set-point. Two are needed")
    late, name = run.meta.get("link_times", {}).get("loop", 0.0), _commanded(run)
    parts = []
    holds = [m.t for m in run.marks if m.kind == "hold"]
    for start, following in zip(starts, [*starts[1:], run.end], strict=True):
        end = min((t for t in holds if start < t < following), default=following)
        part = run.between(start, end)
        switches = [m for m in run.marks if m.kind == "switch" and start <= m.t < end]
        t = np.array([m.t for m in switches]) + 0.5 * float(late)
        ref = Channel(name, SIGNALS[name][0], t, np.array([float(m.detail[name]) for m in switches]))
        begun = next(m for m in run.marks if m.kind == "relay" and m.t == start)
        parts.append(
            replace(
                part,
                channels={**part.channels, name: ref},
                meta={**run.meta, "manoeuvre": "relay", "x_a": begun.detail["x_a"]},
            )
        )
    return parts


def oscillation_of(loop: TransferFunction) -> tuple[float, float]:
    """Return the natural frequency [rad/s] and the damping ratio of the slower pair of poles of a stable *loop*."""
    poles: Sequence[complex] = sorted(loop.poles(), key=abs)
    pairs = [p for p in poles if p.imag > 1e-9]
    if pairs:
        return float(abs(pairs[0])), float(-pairs[0].real / abs(pairs[0]))
    product, total = poles[0].real * poles[1].real, -(poles[0].real + poles[1].real)
    return math.sqrt(product), float(total / (2.0 * math.sqrt(product)))


def _overshoot(loop: TransferFunction) -> float:
    """Return the overshoot of the loop, relative to the step."""
    return max(float(_step_of(loop)[1].max()) - 1.0, 0.0)


def _step_of(loop: TransferFunction) -> tuple[Array, Array]:
    """Return times (n,) [s] and the response (n,) to a unit step, by partial fractions, without the delay."""
    poles = loop.poles()
    s = poles.astype(np.complex128)
    top = np.polyval(list(reversed(loop.numerator)), s)
    slope = np.polyval(np.polyder(list(reversed(loop.denominator))), s)
    t = np.linspace(0.0, 30.0 / float(np.abs(poles).min()), 3000)
    return t, 1.0 + np.real((top / (slope * s))[None, :] * np.exp(np.outer(t, s))).sum(axis=1)
