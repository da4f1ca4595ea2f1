"""Whether a fit explains all there is: what it leaves may be noise."""

from __future__ import annotations

from gcs_autotune.diagnose.judging import SIGNIFICANCE, Found
from gcs_autotune.diagnose.whiteness import tests_of, whiteness_of
from gcs_autotune.identify.extended.fitting import Fitted, Problem

__all__ = ["explains_all", "leaves_nothing"]


def leaves_nothing(problem: Problem, fit: Fitted) -> bool:
    """Whether what a fit leaves of the runs it was fitted to may be noise."""
    return whiteness_of(tests_of(problem, fit)) >= SIGNIFICANCE


def explains_all(problem: Problem, found: Found) -> bool:
    """Whether some candidate of a step leaves nothing of the runs it was fitted to, whether or not it foretells any."""
    return any(leaves_nothing(problem, j.fitted) for j in found.judged if j.evidence > 0.0)
