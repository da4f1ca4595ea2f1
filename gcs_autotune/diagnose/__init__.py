"""What a simulation gets wrong, and why: :func:`diagnose`.

====================  =================================================================
api                   the search from end to end
intake                runs prepared, or rejected with the reason
excitation_check      whether runs can distinguish causes at all
state                 the question, the model so far, one step
strategies            what follows a state: search, retries, removal
search                one step of the search
retries               the search repeated on all runs, or on pieces of them
search_with_noise     the search with a drifting force in the model
candidates            effects worth a fit; fitted roughly, then finally
starting_points       starting points for fits where the plain model diverges
score                 evidence, gain, winner
evidence              gain of each cause; hints: causes with too little evidence
heldout               errors on held-out data
adequacy              what remains; would a law without a physical cause be better?
resonance_check       waves, or ringing of the craft itself
numbers               which numbers of a supplied model are wrong
simulation            a user's simulator, modelled
simulation_alignment  its clock, order, signs and units against the run's
command_match         the same by the commands that both files contain
result                the result
report_builder        from a finished search to a :class:`Diagnosis`
craft_changes         has a craft changed between two identifications?
====================  =================================================================

Prepared runs and fits with effects come from :mod:`gcs_autotune.identify.extended`.
"""

from __future__ import annotations

from gcs_autotune.diagnose.api import WORK, diagnose
from gcs_autotune.diagnose.craft_changes import CHANGES, CraftChange, CraftComparison, compare_craft
from gcs_autotune.diagnose.heldout import METRIC
from gcs_autotune.diagnose.result import (
    Cause,
    Diagnosis,
    ErrorReduction,
    Hint,
    Lack,
    MissingCurve,
    MissingForce,
    Number,
    Numbers,
    Portrait,
    Ranked,
    Signature,
    Value,
    Verdict,
)

__all__ = [
    "CHANGES",
    "METRIC",
    "WORK",
    "Cause",
    "CraftChange",
    "CraftComparison",
    "Diagnosis",
    "ErrorReduction",
    "Hint",
    "Lack",
    "MissingCurve",
    "MissingForce",
    "Number",
    "Numbers",
    "Portrait",
    "Ranked",
    "Signature",
    "Value",
    "Verdict",
    "compare_craft",
    "diagnose",
]
