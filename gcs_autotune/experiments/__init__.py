"""What runs can and cannot tell, which manoeuvre to fly next, and which structure they justify.

==================  ===================================================================================
comparison          two models by where a step settles and how soon
identifiability     parameters that move together, parameters the runs hardly see
scales              how much of a parameter would be felt: what makes a standard error large
profile_likelihood  of one parameter: an interval that is honest where it is not closed
preview             a manoeuvre flown by the model within what the runs have used; the room it takes
next_manoeuvre      the manoeuvres ranked by what they would add
cross_validation    folds, likelihood and errors on data left out
form_choice         coupled forms weighed by information criteria and errors on data left out
drag_choice         the same for the drag of one degree of freedom, beside Miskovic2010, eq. (7.1)-(7.2)
pictures            the same in figures
==================  ===================================================================================

The information itself is the fit's own: :mod:`gcs_autotune.identify.information`.
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
