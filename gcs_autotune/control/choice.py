"""How fast a closed loop may be: within the actuator's range, its own delay and the measured uncertainty.

Miskovic2010, section 8.1.4 and 8.3.5: the model function is chosen such that the required step does not saturate the
actuator. Margins are those of python-control.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control.feedback import FeedbackLaw
from gcs_autotune.control.ipd import Uncertainty, design_ipd, stability_bound
from gcs_autotune.control.reference_model import ReferenceModel, reference_model
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = [
    "LEAST_MARGINS",
    "AxisLoop",
    "LoopMargins",
    "OwnDesign",
    "design_own",
    "margins",
    "simulated_step",
    "step_response",
]

USED = 0.8
"""Fraction of the actuator's range that the required step may use; the rest is for waves and wind."""
LEAST_VECTOR_MARGIN = 0.5
"""Least distance of the loop with its delay from -1: a sensitivity peak of 2, which implies a gain margin of 2 and a
phase margin of 29 degrees (Astrom2008)."""
SLOWEST, FASTEST = 0.02, 20.0
"""Characteristic frequencies among which the fastest is looked for [rad/s]."""
TICK = 0.1
"""Control period of the simulated step [s], as a link at 10 Hz gives."""
SAMPLED = 1.0
"""Delay of the sampled loop in addition to that of the craft, in control periods: half for the hold of the command,
half for a measurement that is on average half a period old."""
PADE_ORDER = 3
ROUNDS = 40
DIVERGED = 100.0
"""Position in steps beyond which a simulated loop counts as diverged."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LoopMargins(Displayed):
    """Margins of a loop with its delay.

    ``gain``: factor by which the gain may grow or shrink, infinite if any may be; ``phase`` [rad]; ``vector``: least
    distance from -1, 1/M_s, at most 1.
    """

    gain: float
    phase: float
    vector: float


LEAST_MARGINS = LoopMargins(1.0, 0.0, LEAST_VECTOR_MARGIN)


@dataclass(frozen=True, slots=True)
class OwnDesign(Displayed):
    """A law with what it promises.

    Attributes
    ----------
    model : the identified one, its delay with that of the sampled loop.
    bound : (left, right) of the stability condition for the measured uncertainty; stable while left < right.
    effort : largest command in the required step, in units of the input.
    limited_by : why the loop cannot be faster, in words.
    """

    law: FeedbackLaw
    model: SingleDof
    wanted: ReferenceModel
    margins: LoopMargins
    bound: tuple[float, float]
    effort: float
    limited_by: str


@dataclass(frozen=True, slots=True)
class AxisLoop:
    """The designed loop of one motion, with the inverse of its actuator.

    ``output`` : force to normalised output (Miskovic2010, fig. 8.2: actuator nonlinearity compensation).
    """

    design: OwnDesign
    output: Callable[[float], float]


def margins(law: FeedbackLaw, model: SingleDof) -> LoopMargins:
    """Return the margins of the loop, opened at the actuator, with the model's delay as a Pade approximation."""
    import control

    s = control.tf("s")
    K_I = law.K_I if law.structure.integral else 0.0
    K_D = law.K_D if law.structure.derivative else 0.0
    loop = (K_D * s**2 + law.K_P * s + K_I) / (s**2 * (model.alpha * s + model.beta))
    if model.delay > 0.0:
        loop = loop * control.tf(*control.pade(model.delay, PADE_ORDER))
    gain, phase, vector, *_ = control.stability_margins(loop)
    # at high frequencies the loop is 0, a distance of 1 from -1, which counts where no minimum lies below it
    return LoopMargins(max(float(gain), 1.0 / float(gain)), math.radians(float(phase)), min(float(vector), 1.0))


def step_response(
    law: FeedbackLaw, model: SingleDof, step: float, seconds: float, *, push: float = 0.0, push_at: float = math.inf
) -> tuple[Array, Array, Array, Array]:
    """Simulate a *step* [rad or m] from rest on *model*, its delay included.

    Return time [s], position, velocity and command, each (n,); they end early if the loop diverges.

    push : constant force from ``push_at`` [s] on, in units of the input.
    """
    controller, inside = law.started(-model.delta if law.structure.integral else 0.0), 10
    late = [0.0] * max(round(model.delay / TICK), 0)
    eta = nu = 0.0
    rows = []
    for k in range(max(round(seconds / TICK), 1)):
        command = controller.update(step, eta, nu, k * TICK)
        rows.append((k * TICK, eta, nu, command))
        late.append(command)
        force = late.pop(0) + (push if k * TICK >= push_at else 0.0)
        for _ in range(inside):
            nu += TICK / inside * model.acceleration(nu, force)
            eta += TICK / inside * nu
        if not math.isfinite(eta) or abs(eta) > DIVERGED * abs(step):
            break
    t, position, velocity, commands = np.array(rows).T
    return t, position, velocity, commands


def simulated_step(law: FeedbackLaw, model: SingleDof, step: float, seconds: float) -> tuple[float, float]:
    """Return (largest command, largest velocity) of a *step* [rad or m] from rest; infinite if the loop diverges."""
    t, _, velocity, command = step_response(law, model, step, seconds)
    if len(t) < max(round(seconds / TICK), 1):
        return math.inf, math.inf
    return float(np.max(np.abs(command))), float(np.max(np.abs(velocity)))


def design_own(
    identified: SingleDof,
    uncertainty: Uncertainty,
    *,
    step: float,
    limits: tuple[float, float],
    kind: str = "bessel",
    omega_0: float | None = None,
    least: LoopMargins = LEAST_MARGINS,
    bandwidth: float = 1.0,
) -> OwnDesign:
    """Return the I-PD law of the fastest loop that keeps its limits, or of the required *omega_0* [rad/s].

    Parameters
    ----------
    step : the largest step [rad or m] that must not saturate the actuator.
    limits : smallest and largest input, in units of the model.
    least : margins that the loop must keep.
    bandwidth : frequency of the loop relative to the fastest one; it is lower still if that breaks a limit.

    Raises
    ------
    NoGainsMeetSpec
        The required frequency, or every one, breaks a limit; the message has the number and the nearest that is
        feasible.
    """
    model = replace(identified, delay=identified.delay + SAMPLED * TICK)
    demands = _Demands(model, uncertainty, step, limits, least)
    fastest, why = demands.fastest(kind)
    if bandwidth < 1.0 and fastest > 0.0:
        fastest, why = demands.fastest(kind, bandwidth * fastest)[0], f"{bandwidth:.0%} of the fastest is required"
    if not fastest > 0.0:
        raise NoGainsMeetSpec(f"no controller of this kind is possible for the {model.axis.name} axis: {why}")
    if omega_0 is not None and omega_0 > fastest:
        why = demands.broken(reference_model(kind, omega_0))
        raise NoGainsMeetSpec(
            f"a loop of {omega_0:g} rad/s is too fast: {why}. The fastest that is possible is {fastest:.2g} rad/s"
        )
    wanted = reference_model(kind, fastest if omega_0 is None else omega_0)
    law = design_ipd(model, wanted, uncertainty).with_limits(*limits)
    effort, velocity = simulated_step(law, model, step, _horizon(wanted))
    return OwnDesign(
        law,
        model,
        wanted,
        margins(law, model),
        stability_bound(model, wanted, uncertainty, velocity),
        effort,
        why if omega_0 is None else "the required frequency",
    )


@dataclass(frozen=True, slots=True)
class _Demands:
    """What a loop must keep: see :func:`design_own`."""

    model: SingleDof
    uncertainty: Uncertainty
    step: float
    limits: tuple[float, float]
    least: LoopMargins

    def fastest(self, kind: str, most: float = FASTEST) -> tuple[float, str]:
        """Return the largest frequency up to *most* without a broken limit, and what limits it; 0 if there is none.

        A loop much slower than the craft itself is not safer: its velocity gain is negative. So the search goes
        downwards.
        """
        why = "this is the highest frequency searched"
        for omega in np.geomspace(most, min(SLOWEST, most), ROUNDS):
            broken = self.broken(reference_model(kind, float(omega)))
            if not broken:
                return float(omega), why
            why = broken
        return 0.0, why

    def broken(self, wanted: ReferenceModel) -> str:
        """Return which limit the loop *wanted* breaks, in words with its numbers; empty if none."""
        model, least = self.model, self.least
        law = design_ipd(model, wanted, self.uncertainty)
        effort, velocity = simulated_step(law, model, self.step, _horizon(wanted))
        most = USED * min(-self.limits[0], self.limits[1])
        if effort > most:
            share = 100.0 * USED * effort / most
            return f"its step would need {share:.3g} % of the available output, and {100.0 * USED:.0f} % may be used"
        left, right = stability_bound(model, wanted, self.uncertainty, velocity)
        if left >= right:
            return f"the model is too uncertain to guarantee its stability ({left:.2g} must be below {right:.2g})"
        found = margins(law, model)
        for name, value, enough, factor, unit in (
            ("vector margin", found.vector, least.vector, 1.0, ""),
            ("gain margin", found.gain, least.gain, 1.0, ""),
            ("phase margin", found.phase, least.phase, math.degrees(1.0), " deg"),
        ):
            if not value >= enough:
                return (
                    f"its {name} would be {factor * value:.2g}{unit} with a delay of {model.delay:.2g} s; "
                    f"{factor * enough:.2g}{unit} is required"
                )
        return ""


def _horizon(wanted: ReferenceModel) -> float:
    return 8.0 / wanted.omega_0
