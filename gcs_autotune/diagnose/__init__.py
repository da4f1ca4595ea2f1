"""Identify what a simulation gets wrong, and why: :func:`diagnose`.

====================  ============================================================================
api                   the search from start to end
intake                preparation of runs, or their rejection with the reason
excitation_check      test whether runs can distinguish causes at all
state                 the question, the model so far, one step
strategies            search, retries and removal of causes, as steps from state to state
search                one step of the search
retries               the search repeated on all runs, or on pieces of them
search_with_noise     the search with a drifting force in the model
candidates            selection of promising effects, and their rough and final fits
starting_points       starting points for fits, if the plain model diverges
score                 evidence, gain and winner of a step
evidence              evidence for each cause; hints, which are causes that the runs do not establish
heldout               errors on held-out data
adequacy              tests of the residuals, and comparison with laws without a physical cause
resonance_check       test whether an apparent wave is ringing of the craft itself
numbers               wrong numbers of a supplied model
simulation            model of the output of a user's simulator
simulation_alignment  clock, order, signs and units of that output relative to the run
command_match         the same from the commands that both files contain
result                the result
report_builder        conversion of a finished search to a :class:`Diagnosis`
craft_changes         changes of a craft between two identifications
parameter_table       test whether a table of identified parameters describes one craft
====================  ============================================================================

Prepared runs and fits with effects come from :mod:`gcs_autotune.identify.extended`.
"""

from __future__ import annotations

from gcs_autotune.diagnose.api import WORK, diagnose
from gcs_autotune.diagnose.craft_changes import CHANGES, RUN_SPREAD, CraftChange, CraftComparison, compare_craft
from gcs_autotune.diagnose.heldout import METRIC
from gcs_autotune.diagnose.parameter_table import (
    ParameterTable,
    TableFinding,
    diagnose_table,
    is_parameter_table,
    read_parameter_table,
)
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
    "RUN_SPREAD",
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
    "ParameterTable",
    "Portrait",
    "Ranked",
    "Signature",
    "TableFinding",
    "Value",
    "Verdict",
    "compare_craft",
    "diagnose",
    "diagnose_table",
    "is_parameter_table",
    "read_parameter_table",
]
