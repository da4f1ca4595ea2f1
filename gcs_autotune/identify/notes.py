"""What was noted about a run before it came here, by a log reader or at the door, as doubts."""

from __future__ import annotations

from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Trial

__all__ = ["told"]


def told(trial: Trial) -> list[Doubt]:
    """Return what is already doubtful about a run, from its ``meta["notes"]``."""
    return [Doubt(*(str(part) for part in note)) for note in trial.meta.get("notes", ()) if len(note) == 3]
