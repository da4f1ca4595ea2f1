"""What a simulation gets wrong, and why: :func:`diagnose`.

===========  =======================================================================
door         from runs to a verdict
intake       runs made fit, or refused with the reason (implausible, worth, follows)
simulated    somebody else's simulator, modelled
numbers      which numbers of a given model are wrong
pieces       a second look where free runs are lost
workers      work shared among processes
result       what comes out
screen       which effects are worth a fit
attempts     one candidate fitted: roughly, to the end
bases        other bases to begin at
rewiring     wiring tried the other way round, the base found anew
footholds    causes of short pieces, where whole runs are lost
heldout      errors on data left out (unspoilt)
whiteness    is anything left?
judging      evidence, gain, who wins
search       cause after cause, with second thoughts (ahead, usual)
telling      from a finished search to a :class:`Diagnosis` (lateness)
signature    what is left, in words and pictures
===========  =======================================================================

Runs made ready and fits with effects come from :mod:`gcs_autotune.identify.extended`.
"""

from __future__ import annotations

from gcs_autotune.diagnose.door import diagnose
from gcs_autotune.diagnose.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
