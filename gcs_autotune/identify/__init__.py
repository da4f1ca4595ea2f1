"""From recorded runs to a model with its uncertainty.

:func:`fit` and :func:`fit_axis` fit; :data:`METHODS` is the table of methods. Each returns a :class:`Fit` with
parameters, covariance, traces and doubts. :func:`validate` predicts other runs with the fitted model, and
:func:`save_model` writes the model to a file.

Other packages import from these subpackages:

===============  ==================================================================================================
``signals``      a run as segments with checked signals, before any model
``problems``     data and a form as an optimisation problem, with its solution and its information
``kalman``       filters: fits with process noise for one degree of freedom, and the filter methods
``open_loop``    readings of steps, zig-zags and helm orders; the methods ``step`` and ``zig-zag``
``relay``        limit cycles
``frequency``    frequency responses
``regression``   motion and inputs on an even grid, and the linear equations of motion on them
``thrust``       actuators that are weak, dead or curved, identified together with the craft
``plan``         sequenced experiments
===============  ==================================================================================================

The methods: ``axis`` is for one degree of freedom and decides structure and delay. ``coupled`` is for forms,
``extended`` for forms with effects. The other methods are in the packages above. Each method takes a ``Case``. It
returns the ``Fit`` that ``fit_builder`` builds from the table of its parameters.
"""

from __future__ import annotations

from gcs_autotune.identify.api import fit, fit_axis, form_of, scaled_form
from gcs_autotune.identify.axis.form import DAMPING, Structure, structure_of
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt, Grade
from gcs_autotune.identify.doubts import reversed_input
from gcs_autotune.identify.free_run import Validation, validate
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.methods import METHODS
from gcs_autotune.identify.model_file import ModelFile, load_model, model_document, model_file_of, save_model
from gcs_autotune.identify.moved import MOVED_TOO, moved_besides, moved_too
from gcs_autotune.identify.result import (
    AxisFit,
    Decision,
    Fit,
    IsoEstimate,
    LimitCycle,
    Model,
    Parameter,
    Status,
    StructureFit,
    Trace,
    is_of_one_axis,
)
from gcs_autotune.identify.signals.intake import CONTRADICTION
from gcs_autotune.identify.signals.segment import MIN_SAMPLES
from gcs_autotune.identify.signals.whiteness import Remainder
from gcs_autotune.identify.simulation import extended_of, simulated

__all__ = [
    "CONTRADICTION",
    "DAMPING",
    "METHODS",
    "MIN_SAMPLES",
    "MOVED_TOO",
    "AxisFit",
    "Case",
    "Decision",
    "Doubt",
    "Fit",
    "Grade",
    "IsoEstimate",
    "LimitCycle",
    "Method",
    "Model",
    "ModelFile",
    "Parameter",
    "Remainder",
    "Status",
    "Structure",
    "StructureFit",
    "Trace",
    "Validation",
    "extended_of",
    "fit",
    "fit_axis",
    "form_of",
    "is_of_one_axis",
    "load_model",
    "model_document",
    "model_file_of",
    "moved_besides",
    "moved_too",
    "reversed_input",
    "save_model",
    "scaled_form",
    "simulated",
    "structure_of",
    "validate",
]
