"""Describe one degree of freedom as a form: its damping and its parameter names.

Three equivalent sets of numbers describe one axis:

===========  =======================================================================================
explicit     ``(b, a, c, d, delay)`` of :class:`Explicit`, used in fits, which are nearly linear in them
physical     ``(alpha, beta, beta_quadratic, delta, delay)`` of :class:`SingleDof`, used in results
derivatives  ``(N_rdot, N_r, N_rr, N_0, delay)`` of :func:`axis_form` (yaw), used in coupled forms
===========  =======================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.models import CoupledModel, Form, SingleDof, explicit_parameters
from gcs_autotune.registry import lookup
from gcs_autotune.sname import Dof

__all__ = [
    "DAMPING",
    "FREE",
    "PHYSICAL",
    "SIGNS",
    "Explicit",
    "ExplicitForm",
    "Structure",
    "as_coupled",
    "as_extended",
    "axis_form",
    "derivatives_of",
    "structure_of",
]

Array = NDArray[np.float64]

Structure = Literal["linear", "nonlinear", "affine"]
"""Names of the drag structures, as in Miskovic2010.

``linear`` = linear damping, ``nonlinear`` = quadratic damping (``|nu| nu``), ``affine`` = both.
"""

DAMPING: Mapping[str, str] = {
    "linear": "linear damping",
    "nonlinear": "quadratic damping",
    "affine": "linear and quadratic damping",
}
"""Structure -> its usual name (Miskovic2010: linear and nonlinear model)."""

FREE: Mapping[Structure, tuple[bool, bool, bool, bool]] = {
    "linear": (True, True, False, True),
    "nonlinear": (True, False, True, True),
    "affine": (True, True, True, True),
}
"""Drag structure -> whether inertia, linear drag, quadratic drag and constant force are fitted, in this order."""

PHYSICAL = ("alpha", "beta", "beta_quadratic", "delta", "delay")
"""Names of the physical parameters, in the order used in every covariance."""

SIGNS = (-1.0, -1.0, -1.0, 1.0, 1.0)
"""Signs that convert derivatives (N_rdot, N_r, N_rr, N_0, delay) to (alpha, beta, beta_quadratic, delta, delay)."""


def structure_of(name: str) -> Structure:
    """Return the drag structure called *name* as a :data:`Structure`.

    Raises
    ------
    UnknownName
        There is no structure of this name.
    """
    return lookup({str(n): n for n in FREE}, name, "drag structure")


class Explicit(NamedTuple):
    """Parameters of the equation ``nu_dot = b*tau(t - delay) - a*nu - c*|nu|*nu + d``.

    The order is that of :class:`ExplicitForm`.
    """

    b: float
    a: float
    c: float
    d: float
    delay: float

    @classmethod
    def of(cls, model: SingleDof) -> Explicit:
        """Return the explicit parameters of *model*. The inertia of *model* must not be zero."""
        return cls(*explicit_parameters(model))

    @property
    def physical(self) -> Array:
        """Physical parameters (5,), in the order of :data:`PHYSICAL`."""
        b, a, c, d, delay = self
        return np.array([1.0 / b, a / b, c / b, d / b, delay])

    @property
    def physical_slopes(self) -> Array:
        """Jacobian (5, 5): derivatives of the physical parameters by the explicit ones."""
        b, a, c, d, _ = self
        G = np.diag([-1.0 / b**2, 1.0 / b, 1.0 / b, 1.0 / b, 1.0])
        G[1:4, 0] = [-a / b**2, -c / b**2, -d / b**2]
        return G

    def model(self, dof: Dof, input_unit: str) -> SingleDof:
        """Return the model of *dof* in physical parameters, with the input in *input_unit*."""
        return SingleDof(dof.name, input_unit, *self.physical.tolist())

    def later(self, seconds: float) -> Explicit:
        """Return these parameters with the delay increased by *seconds*."""
        return self._replace(delay=self.delay + seconds)


@dataclass(frozen=True, slots=True)
class ExplicitForm(Form):
    """Form of one degree of freedom whose parameters are those of :class:`Explicit`.

    The exact kernel of :mod:`..models.simulation` simulates the form. The motion is nearly linear in these parameters.
    A limit on a drag rate is a limit on a single parameter.
    """

    def __post_init__(self) -> None:
        """Skip the checks of :class:`Form`, because these parameters are not derivatives."""

    @classmethod
    def of(cls, dof: Dof) -> ExplicitForm:
        """Return the explicit form for the degree of freedom *dof*."""
        return cls(f"{dof.name}/explicit", dof.name, (dof.name,), Explicit._fields, {}, {})


def axis_form(dof: Dof, input_name: str, structure: Structure, *, normalised: bool, delay: float | None = 0.0) -> Form:
    """Return the form of one degree of freedom with the drag *structure* and the input *input_name*.

    In roll and pitch it includes the restoring moment of weight and buoyancy.

    normalised : whether the input is a fraction of full output (unit 1).
    delay : fixed value [s]. 0 omits the delay, None makes it a free parameter.
    """
    names = dof.derivative_names()
    free = [n for n, on in zip(names[:4], FREE[structure], strict=True) if on]
    if dof.restored:
        free.append(dof.restoring_derivative)
    known = {} if not delay else {"delay": float(delay)}
    return Form(
        name=f"{dof.name}/{structure}",
        title=f"{dof.name}, {DAMPING[structure]}",
        dofs=(dof.name,),
        free=tuple(free if delay is not None else [*free, "delay"]),
        known=known,
        inputs={input_name: ((dof.force, 1.0),)},
        coriolis=False,
        normalised=normalised,
    )


def derivatives_of(axis: SingleDof) -> dict[str, float]:
    """Return name -> value of the derivatives of *axis*, its delay and, in roll and pitch, its restoring moment."""
    dof = axis.axis
    numbers = (axis.alpha, axis.beta, axis.beta_quadratic, axis.delta, axis.delay)
    values = {n: s * v for n, s, v in zip(dof.derivative_names(), SIGNS, numbers, strict=True)}
    return values | ({dof.restoring_derivative: -axis.restoring} if dof.restored else {})


def as_coupled(axis: SingleDof, input_name: str) -> CoupledModel:
    """Return *axis*, driven by *input_name*, as a coupled model with the same delay."""
    values = derivatives_of(axis)
    form = axis_form(axis.axis, input_name, "affine", normalised=axis.input_unit == "1", delay=axis.delay)
    return CoupledModel(form, {n: values[n] for n in form.parameters})


def _lacks_drag(structure: Structure, axis: SingleDof) -> bool:
    _, linear, quadratic, _ = FREE[structure]
    return bool((axis.beta and not linear) or (axis.beta_quadratic and not quadratic))


def as_extended(axis: SingleDof) -> ExtendedModel:
    """Return *axis* as a coupled model with effects, in which its delay is the effect ``input-delay``."""
    dof = axis.axis
    channel = "delta" if axis.input_unit == "rad" else dof.force
    structure = next(s for s in FREE if not _lacks_drag(s, axis))
    form = axis_form(dof, channel, structure, normalised=axis.input_unit == "1")
    values = derivatives_of(axis)
    base = CoupledModel(form, {n: values[n] for n in form.parameters})
    delay = (EffectInstance("input-delay", channel, {"delay": axis.delay}),) if axis.delay > 0.0 else ()
    return ExtendedModel(base, delay)
