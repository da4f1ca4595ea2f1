"""What a simulation gets wrong, and why: :func:`diagnose`.

================  =======================================================================
api               from runs to a verdict
intake            runs made fit, or refused with the reason
excitation_check  whether runs can tell causes apart at all
state             what was asked, the model so far, one step
strategies        what makes the next state of one: the search, and second looks
candidates        which effects are worth a fit; fitted roughly, to the end
starting_points   where fits may begin where the base is lost
score             evidence, gain, who wins
evidence          the gain of each cause, and hints: causes supported too weakly to be named
heldout           errors on data left out
adequacy          is anything left? would a law without a name do better?
resonance_check   a wave, or the craft's own ringing
numbers           which numbers of a given model are wrong
simulation        somebody else's simulator, modelled
two_records       its file beside the measured one: clock, order, signs and units
command_match     the same by the commands that both files hold
result            what comes out
report_builder    from a finished search to a :class:`Diagnosis`
workers           work shared among processes
craft_changes     has a craft changed between two identifications?
================  =======================================================================

Runs made ready and fits with effects come from :mod:`gcs_autotune.identify.extended`.
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
