"""What is unphysical in a coupled model, in words."""

from __future__ import annotations

import numpy as np

from gcs_autotune.identify.coupled.limits import physical
from gcs_autotune.identify.result import Fit
from gcs_autotune.models.coupled import CoupledModel
from gcs_autotune.models.coupled.derivatives import inertia_of

__all__ = ["complaints_about"]

SURE = 3.0
"""Standard errors by which a drag must be on the wrong side of zero to be complained about."""


def complaints_about(fit: Fit) -> tuple[str, ...]:
    """Return what in *fit* no craft can have: inertia that is not positive, drag that drives.

    Inertia must be symmetric positive definite (Fossen2011, (3.54)); a craft's own drag may only damp. Yaw may be
    driven by sway, so no more is asked of the damping than its diagonal.
    """
    model = fit.model
    if not isinstance(model, CoupledModel):
        return ()
    found = []
    M = model.inertia
    if float(np.linalg.eigvalsh(0.5 * (M + M.T)).min()) <= 0.0:
        found.append("its inertia is not positive")
    for name in physical(model.form).high:
        parameter = fit.parameters.get(name)
        if inertia_of(name) is None and parameter is not None and parameter.value > SURE * parameter.std:
            found.append(f"{name} drives instead of damping")
    return tuple(found)
