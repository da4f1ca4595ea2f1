"""Coupled degrees of freedom: ``M nu_dot + C(nu) nu = F(nu, eta, inputs)`` in SNAME derivatives.

============  ===========================================================================
derivatives   derivative names parsed as terms
form          the terms of a model (TOML files in ``forms/``); the table :data:`FORMS`
model         a form with numbers: matrices, simulation, sensitivities
program       a form converted to the arrays that the kernel uses
kernel        the compiled simulation
regressors    the same equations as rows linear in the parameters
============  ===========================================================================
"""

from __future__ import annotations

from gcs_autotune.models.coupled.derivatives import unit_of
from gcs_autotune.models.coupled.form import FORMS, Form, form_from, load_form
from gcs_autotune.models.coupled.model import CoupledModel, CoupledMotion, Simulator

__all__ = ["FORMS", "CoupledModel", "CoupledMotion", "Form", "Simulator", "form_from", "load_form", "unit_of"]
