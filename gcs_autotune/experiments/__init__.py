"""Identifiability, design of the next experiment, and selection of the model structure.

==================  ===================================================================================
comparison          two models compared by final value and rise time of a step
identifiability     correlated and poorly identifiable parameters
scales              the size of a parameter with a noticeable effect
profile_likelihood  interval of one parameter, open if the runs do not bound it
preview             simulated manoeuvre inside the range of the runs, and its space
next_manoeuvre      manoeuvres ranked by expected improvement
cross_validation    folds, likelihood and held-out errors
form_choice         coupled forms compared by information criteria and held-out errors
drag_choice         the same for the drag of one degree of freedom, with Miskovic2010, eq. (7.1)-(7.2)
pictures            figures of these results
==================  ===================================================================================

The information matrix is that of the fit: :mod:`gcs_autotune.identify.problems.information`.
"""

from __future__ import annotations

from gcs_autotune.experiments.comparison import DofComparison, compare_dof, compare_models
from gcs_autotune.experiments.drag_choice import weigh_drags
from gcs_autotune.experiments.form_choice import FormChoice, choose_form, eliminate
from gcs_autotune.experiments.identifiability import Identifiability, identifiability
from gcs_autotune.experiments.next_manoeuvre import (
    RankedManoeuvre,
    Ranking,
    plan_next,
    rank_by_precision,
    relative_errors,
    shortfall,
)
from gcs_autotune.experiments.profile_likelihood import Profile, profile

__all__ = [
    "DofComparison",
    "FormChoice",
    "Identifiability",
    "Profile",
    "RankedManoeuvre",
    "Ranking",
    "choose_form",
    "compare_dof",
    "compare_models",
    "eliminate",
    "identifiability",
    "plan_next",
    "profile",
    "rank_by_precision",
    "relative_errors",
    "shortfall",
    "weigh_drags",
]
