"""Speed of coupled output error against a straightforward SciPy fit of the same runs, in the same process.

Run from the repository root: ``python -m benchmarks.coupled_speed [evaluations]``. Three degrees of freedom, 14
parameters, 3 runs of 600 samples. The SciPy fit uses ``solve_ivp`` at the tolerances that a fit needs, inputs looked up
by stamp, residuals over their noise, ``least_squares`` with its two-point Jacobian, free initial states, and a start
one percent from the truth. Steps are 1e-4, because at the default 1e-8 the solver's noise misleads it.

By default only its first Jacobians are timed, so the ratio is a lower bound; ``all`` runs it to the end. Times are
processor seconds of one core (set OMP_NUM_THREADS=1).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from benchmarks.coupled_accuracy import BOAT, Setting, clean_runs, noisy, settings
from benchmarks.results import Figure, headline
from gcs_autotune.identify import fit
from gcs_autotune.trial import Trial

Array = np.ndarray

NAMES = tuple(BOAT)
STATES = ("psi", "u", "v", "r")
NOISE = {"psi": 0.005, "u": 0.02, "v": 0.02, "r": 0.005}
START = {n: 0.99 * v for n, v in BOAT.items()}
"""Start of the SciPy fit, close enough that it does not diverge; our fit needs no start."""


def rates(p: Array, s: Array, tau: Array) -> list[float]:
    """Return the rates of (psi, u, v, r)."""
    X_ud, Y_vd, N_rd, Y_rd, X_u, X_uu, Y_v, Y_vv, Y_r, N_v, N_r, N_rr, X_0, N_0 = p
    _, u, v, r = s
    X = tau[0] + X_0 + X_u * u + X_uu * abs(u) * u - (Y_vd * v + Y_rd * r) * r
    Y = Y_v * v + Y_vv * abs(v) * v + Y_r * r + X_ud * u * r
    N = tau[1] + N_0 + N_v * v + N_r * r + N_rr * abs(r) * r + (Y_vd * v + Y_rd * r) * u - X_ud * u * v
    det = Y_vd * N_rd - Y_rd * Y_rd
    return [r, -X / X_ud, (-N_rd * Y + Y_rd * N) / det, (Y_rd * Y - Y_vd * N) / det]


def residuals(x: Array, runs: Sequence[Trial]) -> Array:
    """Return all measured minus simulated, over the noise; *x* is the parameters, then four states per run."""
    p, out = x[: len(NAMES)], []
    for i, run in enumerate(runs):
        t, tau = run["X"].t, np.column_stack([run["X"].values, run["N"].values])

        def rhs(now: float, s: Array, t: Array = t, tau: Array = tau) -> list[float]:
            return rates(p, s, tau[min(int(now / (t[1] - t[0]) + 1e-9), len(t) - 1)])

        begin = x[len(NAMES) + 4 * i : len(NAMES) + 4 * i + 4]
        # Longest step: one sample, or the solver would step over changes of the input.
        found = solve_ivp(rhs, (t[0], t[-1]), begin, t_eval=t, rtol=1e-6, atol=1e-9, max_step=t[1] - t[0])
        for k, name in enumerate(STATES):
            simulated = found.y[k] if found.success else np.full(len(t), 1e3)
            out.append((run[name].values - simulated) / NOISE[name])
    return np.concatenate(out)


def straightforward(runs: Sequence[Trial], evaluations: int | None) -> tuple[float, int, Array, bool]:
    """Return processor seconds, Jacobians, solution, and whether it converged."""
    first = [[run[n].values[0] for n in STATES] for run in runs]
    x_0 = np.concatenate([[START[n] for n in NAMES], *first])
    begin = time.process_time()
    found = least_squares(residuals, x_0, args=(runs,), x_scale="jac", diff_step=1e-4, max_nfev=evaluations)
    return time.process_time() - begin, int(found.njev), found.x, found.status > 0


def ours(runs: Sequence[Trial], setting: Setting, repeats: int = 5) -> float:
    """Return the median processor seconds of a warm fit."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        fit(runs, setting.structure)
        times.append(time.process_time() - begin)
    return float(np.median(times))


def main() -> None:
    """Print the figures."""
    setting = settings()["horizontal, 14 parameters"]
    runs = noisy(setting, clean_runs(setting, setting.truth, [np.zeros(6)] * 3), 0)
    begin = time.perf_counter()
    found = fit(runs, setting.structure)
    print(f"ours, first call of the process: {time.perf_counter() - begin:.2f} s (compiled kernels are kept on disk)")
    warm = ours(runs, setting)
    print(f"ours, warm: {warm:.3f} s of one core: {len(NAMES)} parameters, 3 runs x {len(setting.t)} samples")
    for samples in (300, 600):
        part = [run.between(0.0, setting.t[samples - 1]) for run in runs]
        print(f"  {samples:5d} samples per run: {1e3 * ours(part, setting):6.0f} ms")
    for times in (2, 4):
        more = [Trial(f"{run.name}, {k}", run.channels) for k in range(times) for run in runs]
        print(f"  {600 * times:5d} samples, as {len(more)} runs: {1e3 * ours(more, setting, 3):6.0f} ms")
    headline(
        "coupled_speed", "processor time of a coupled fit of 14 parameters", [Figure("warm fit, median", warm, "s")]
    )
    limit = sys.argv[1] if len(sys.argv) > 1 else "3"
    seconds, jacobians, x, ended = straightforward(runs, None if limit == "all" else int(limit))
    print(f"solve_ivp + least_squares: {seconds:.1f} s for {jacobians} Jacobians{' to its end' if ended else ''}")
    print(f"  that is {seconds / warm:.0f} times ours{'' if ended else ' already, and it was not finished'}")
    if ended:
        off = [abs(x[i] - found.parameters[n].value) / found.parameters[n].std for i, n in enumerate(NAMES)]
        left = float(np.mean(residuals(x, runs) ** 2))
        print(
            f"  it ends {max(off):.1f} standard errors from ours, at {left:.3f} mean squared residuals (1: the noise)"
        )


if __name__ == "__main__":
    main()
