"""Standard errors predicted for proposed manoeuvres, against the scatter of a Monte-Carlo simulation.

    python -m benchmarks.next_manoeuvre [seeds]

A small boat has flown a circle. For some of the manoeuvres proposed next it compares the standard errors, predicted
from the fit of that circle, with the scatter of estimates over many noisy repetitions of circle and manoeuvre. The true
boat flies them in a simulator that shares nothing with the package.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "plants"))

from experiment_plants import BOAT, circle, recorded

from benchmarks.results import Figure, headline
from gcs_autotune.experiments import plan_next
from gcs_autotune.identify import fit
from gcs_autotune.models.coupled import FORMS

FORM = FORMS["horizontal"].without("Y_0", "Y_vv", "Y_rdot", "X_0", "N_0")
FORM = replace(FORM, start={k: 0.9 * v for k, v in BOAT.items()})
CHOSEN = ("S-manoeuvre-with-changing-throttle", "zig-zag-20-20-at-60-throttle", "turning-circle-at-60-throttle")


def main(seeds: int) -> None:
    first = recorded(circle(wobble=0.02), 60.0, 1, after=10.0)
    proposal = plan_next(fit([first], FORM, delay=0.0), [first], seconds=40.0)
    print("best first: " + "; ".join(p.candidate.title for p in proposal.plans[:5]))
    ratios: list[float] = []
    for name in CHOSEN:
        plan = next(p for p in proposal.plans if p.candidate.name == name)
        flown = plan.flight.inputs

        def helm(t: float, _: np.ndarray, inputs: np.ndarray = flown) -> tuple[float, float]:
            X, N = inputs[min(round(10.0 * t), len(inputs) - 1)]
            return float(X), float(N)

        estimates = []
        for seed in range(seeds):
            again = recorded(circle(wobble=0.02), 60.0, 1000 + seed, after=10.0)
            runs = [again, recorded(helm, 40.0, 5000 + seed)]
            found = fit(runs, FORM, delay=0.0).parameters
            estimates.append([found[n].value for n in proposal.names])
        scatter = np.std(estimates, axis=0, ddof=1)
        print(f"\n{plan.candidate.title}: {seeds} seeds")
        print(f"{'':8s}{'truth':>9s}{'circle':>10s}{'predicted':>10s}{'scatter':>10s}{'ratio':>7s}")
        for i, n in enumerate(proposal.names):
            before, after, found = proposal.now.information.std[i], plan.std[i], scatter[i]
            ratios.append(float(found / after))
            print(f"{n:8s}{BOAT[n]:9.2f}{before:10.3g}{after:10.3g}{found:10.3g}{found / after:7.2f}")
    figures = [
        Figure(f"scatter / predicted standard error, median, {seeds} seeds", float(np.median(ratios))),
        Figure("scatter / predicted standard error, lowest", min(ratios)),
        Figure("scatter / predicted standard error, highest", max(ratios)),
    ]
    headline("next_manoeuvre", "predicted standard errors of the next manoeuvre, compared with scatter", figures)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
