"""Several degrees of freedom, coupled: ``M nu_dot + C(nu) nu = F(nu, eta, inputs)`` in SNAME derivatives.

============  ===========================================================================
derivatives   derivative names read as terms
form          which terms a model has (TOML files in ``forms/``); the table :data:`FORMS`
model         a form with numbers: matrices, simulation, sensitivities
program       a form made into the arrays the kernel runs
kernel        the compiled sweep
regressors    the same equations as rows linear in the parameters
============  ===========================================================================
"""

from __future__ import annotations

from gcs_autotune.models.coupled.derivatives import unit_of
from gcs_autotune.models.coupled.form import FORMS, Form, form_from, load_form
from gcs_autotune.models.coupled.model import CoupledModel, CoupledMotion, Simulator

__all__ = ["FORMS", "CoupledModel", "CoupledMotion", "Form", "Simulator", "form_from", "load_form", "unit_of"]
