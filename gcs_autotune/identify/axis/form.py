"""One degree of freedom as a form: which damping it has, and what its numbers are called.

Three sets of numbers describe one axis; each follows from the others:

===========  ===================================================================================================
explicit     ``(b, a, c, d, delay)``, :class:`Explicit`: the motion is nearly linear in them, so they are fitted
physical     ``(alpha, beta, beta_quadratic, delta, delay)`` of :class:`SingleDof`: reported
derivatives  ``(N_rdot, N_r, N_rr, N_0, delay)`` of :func:`axis_form` (yaw): shared with coupled forms
===========  ===================================================================================================
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
    "FREE",
    "PHYSICAL",
    "SIGNS",
    "Explicit",
    "ExplicitForm",
    "Structure",
    "as_extended",
    "axis_form",
    "derivative_names",
    "structure_of",
]

Array = NDArray[np.float64]

Structure = Literal["linear", "nonlinear", "affine"]
"""Miskovic2010 says: ``linear`` = linear damping, ``nonlinear`` = quadratic damping (|nu| nu), ``affine`` = both."""

FREE: Mapping[Structure, tuple[bool, bool, bool, bool]] = {
    "linear": (True, True, False, True),
    "nonlinear": (True, False, True, True),
    "affine": (True, True, True, True),
}
"""Structure -> which of inertia, linear drag, quadratic drag and constant force are fitted."""

PHYSICAL = ("alpha", "beta", "beta_quadratic", "delta", "delay")
"""The physical parameters, in the order of every covariance."""

SIGNS = (-1.0, -1.0, -1.0, 1.0, 1.0)
"""Derivative times sign gives (alpha, beta, beta_quadratic, delta, delay)."""


def structure_of(name: str) -> Structure:
    """Return the damping of this name.

    Raises
    ------
    UnknownName
        There is none.
    """
    return lookup({str(n): n for n in FREE}, name, "drag structure")


class Explicit(NamedTuple):
    """``nu_dot = b*tau(t - delay) - a*nu - c*|nu|*nu + d``: the numbers of :class:`ExplicitForm`, in its order."""

    b: float
    a: float
    c: float
    d: float
    delay: float

    @classmethod
    def of(cls, model: SingleDof) -> Explicit:
        """Return the numbers of *model*; its inertia must not be zero."""
        return cls(*explicit_parameters(model))

    @property
    def physical(self) -> Array:
        """The physical parameters (5,)."""
        b, a, c, d, delay = self
        return np.array([1.0 / b, a / b, c / b, d / b, delay])

    @property
    def physical_slopes(self) -> Array:
        """Derivatives (5, 5) of the physical parameters by these."""
        b, a, c, d, _ = self
        G = np.diag([-1.0 / b**2, 1.0 / b, 1.0 / b, 1.0 / b, 1.0])
        G[1:4, 0] = [-a / b**2, -c / b**2, -d / b**2]
        return G

    def model(self, dof: Dof, input_unit: str) -> SingleDof:
        """Return the physical model."""
        return SingleDof(dof.name, input_unit, *self.physical.tolist())

    def later(self, seconds: float) -> Explicit:
        """Return the same with a delay longer by *seconds*."""
        return self._replace(delay=self.delay + seconds)


@dataclass(frozen=True, slots=True)
class ExplicitForm(Form):
    """One degree of freedom in :class:`Explicit` numbers, simulated by the exact kernel of :mod:`..models.simulation`.

    In these numbers the motion is nearly linear, and limits on rates are limits on numbers.
    """

    def __post_init__(self) -> None:
        """Names here are no derivatives, nothing is checked."""

    @classmethod
    def of(cls, dof: Dof) -> ExplicitForm:
        """Return the form of *dof*."""
        return cls(f"{dof.name}/explicit", dof.name, (dof.name,), Explicit._fields, {}, {})


def derivative_names(dof: Dof) -> tuple[str, str, str, str, str]:
    """Return the derivatives behind (alpha, beta, beta_quadratic, delta, delay)."""
    force, nu = dof.force, dof.velocity
    return (f"{force}_{nu}dot", f"{force}_{nu}", f"{force}_{nu}{nu}", f"{force}_0", "delay")


def axis_form(dof: Dof, input_name: str, structure: Structure, *, normalised: bool, delay: float | None = 0.0) -> Form:
    """Return the form of one axis; *delay* None makes it a free parameter, 0 leaves it out."""
    names = derivative_names(dof)
    free = [n for n, on in zip(names[:4], FREE[structure], strict=True) if on]
    known = {} if not delay else {"delay": float(delay)}
    return Form(
        name=f"{dof.name}/{structure}",
        title=f"{dof.name}, {structure} damping",
        dofs=(dof.name,),
        free=tuple(free if delay is not None else [*free, "delay"]),
        known=known,
        inputs={input_name: ((dof.force, 1.0),)},
        coriolis=False,
        normalised=normalised,
    )


def as_extended(axis: SingleDof) -> ExtendedModel:
    """Return a model of one degree of freedom as a coupled one; its delay becomes the effect ``input-delay``."""
    dof = axis.axis
    channel = "delta" if axis.input_unit == "rad" else dof.force
    structure: Structure = "affine" if axis.beta_quadratic else "linear"
    form = axis_form(dof, channel, structure, normalised=axis.input_unit == "1")
    numbers = (axis.alpha, axis.beta, axis.beta_quadratic, axis.delta)
    names = derivative_names(dof)[:4]
    values = {n: s * v for n, s, v in zip(names, SIGNS, numbers, strict=False)}
    base = CoupledModel(form, {n: values[n] for n in form.parameters})
    delay = (EffectInstance("input-delay", channel, {"delay": axis.delay}),) if axis.delay > 0.0 else ()
    return ExtendedModel(base, delay)
