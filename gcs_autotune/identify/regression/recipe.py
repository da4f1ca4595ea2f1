"""Convert records to equations in the same way for measured and simulated records.

Settings are chosen once for the measured records, and then apply to all records derived from them. Instruments come
from simulated records, and the noise bias from records with added noise. These records are processed exactly like the
measured ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.regression.motion import GriddedMotion, motion_of
from gcs_autotune.identify.regression.rows import EQUATIONS, Rows, rows_of
from gcs_autotune.identify.regression.smoothing import SMOOTHERS
from gcs_autotune.identify.regression.solver import Equations, Estimate, row_starts, solve
from gcs_autotune.identify.regression.spread import NoiseDraw, draw_noise, raised
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS

__all__ = ["OPTIONS", "Recipe", "form_of", "recipe_of"]

Array = NDArray[np.float64]

OPTIONS = (
    ("equation", "integral (over short windows, default) or derivative (with smoothed accelerations)"),
    ("derivative", "smoothing (regularised spline, default) or savitzky-golay"),
    ("window", "length of the windows of equation=integral [s] (default: automatic)"),
    ("bias", "True: a constant force in every equation"),
)
"""Options of ``fit`` that set the equations, with a line of help each."""

WINDOWS = (8, 16, 32, 64)
"""Window lengths that are tried [samples]. The one with the smallest standard errors is kept. Project choice."""

LONGEST = 0.125
"""Longest window, as a fraction of the shortest stretch. Project choice."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Settings that convert records to equations.

    - ``form``: the form of the equations.
    - ``equation``, ``derivative``: values of the options of these names.
    - ``window`` [s]: length of the integration window.
    - ``settings``: settings of the smoothers, one mapping per record. It is empty until they are chosen.
    """

    form: Form
    equation: str
    derivative: str
    window: float = 0.0
    settings: tuple[Mapping[str, float], ...] = ()

    def motions(self, records: Sequence[Segment]) -> tuple[GriddedMotion, ...]:
        """Return the smoothed motion of each record."""
        given = self.settings or (None,) * len(records)
        return tuple(motion_of(r, self.form, self.derivative, s) for r, s in zip(records, given, strict=True))

    def rows(self, records: Sequence[Segment], motions: Sequence[GriddedMotion] | None = None) -> list[Rows]:
        """Return the rows of equations of each record."""
        gridded = motions or self.motions(records)
        return [rows_of(r, self.form, m, self.equation, self.window) for r, m in zip(records, gridded, strict=True)]

    def errors(self, draws: Sequence[NoiseDraw], theta: Array) -> list[Array]:
        """Return the acceleration errors (n, k) of every noise draw for the parameters *theta* (p,).

        Draws with a singular M are left out.
        """
        linearised = (self.equations(d.records, d.motions).errors(theta) for d in draws)
        return [f[0] for f in linearised if f is not None]

    def with_spread(self, estimate: Estimate, draws: Sequence[NoiseDraw]) -> Estimate:
        """Return *estimate* with standard errors that include the effect of the signals' noise on the draws."""
        J = estimate.jacobian * estimate.weights[:, :, None]
        bread = inverse_of(estimate.information)
        return raised(estimate, J, bread, self.errors(draws, estimate.theta), estimate.errors)

    def equations(self, records: Sequence[Segment], motions: Sequence[GriddedMotion] | None = None) -> Equations:
        """Return the equations of all *records* as one set."""
        return Equations.of(self.form, self.rows(records, motions))


def form_of(case: Case) -> Form:
    """Return the form to regress.

    A requested delay is fixed in it. With the option ``bias`` every equation has a constant force.
    """
    form = case.the_form
    if case.delay is not None and (case.delay > 0.0 or "delay" in form.parameters):
        form = form.fixing({"delay": case.delay})
    if case.options.get("bias", False):
        constants = [f"{DOFS[d].force}_0" for d in form.dofs]
        form = form.freeing(*(c for c in constants if c not in form.parameters))
    return form


def recipe_of(
    case: Case, *, robust: bool = False
) -> tuple[Recipe, tuple[GriddedMotion, ...], Estimate, tuple[NoiseDraw, ...]]:
    """Return the recipe for *case*, the smoothed motions, the first least-squares estimate, and the noise draws.

    Raises
    ------
    UsageError
        An option has an invalid value.
    MissingChannel, NotInformative
        The records do not contain the signals that the regression needs.
    """
    equation = str(case.options.get("equation", EQUATIONS[0]))
    derivative = str(case.options.get("derivative", "smoothing"))
    lookup(dict.fromkeys(EQUATIONS), equation, "equation")
    lookup(SMOOTHERS, derivative, "way to differentiate")
    form = form_of(case)
    recipe = Recipe(form, equation, derivative)
    motions = recipe.motions(case.records)
    recipe = replace(recipe, settings=tuple(m.settings for m in motions))
    draws = draw_noise(form, derivative, case.records, motions)
    best: tuple[float, Recipe, Estimate] | None = None
    for window in _windows(case, motions) if equation == "integral" else (0.0,):
        tried = replace(recipe, window=window)
        equations = tried.equations(case.records, motions)
        starts = row_starts(equations) if best is None else [best[2].theta]
        estimate = tried.with_spread(solve(equations, starts, robust=robust), draws)
        spread = float(np.sum(np.log(np.maximum(np.diag(estimate.covariance), 1e-300))))
        if best is None or spread < best[0]:
            best = (spread, tried, estimate)
    assert best is not None
    return best[1], motions, best[2], draws


def _windows(case: Case, motions: Sequence[GriddedMotion]) -> tuple[float, ...]:
    given = case.options.get("window")
    if given is not None:
        if not float(given) > 0.0:
            raise UsageError(f"a window of {given} s is not valid. Use more than 0 s")
        return (float(given),)
    step = max(m.step for m in motions)
    shortest = min(float(m.t[-1] - m.t[0]) for m in motions)
    return tuple(w * step for w in WINDOWS if w * step <= LONGEST * shortest) or (WINDOWS[0] * step,)
