"""Sign error: a column counts the other way."""

from __future__ import annotations

from typing import ClassVar

from gcs_autotune.effects.effect import Applied, Drive, Effect, Family, Observed, Scene, columns_of, concerns
from gcs_autotune.effects.visibility import sign_is_free

__all__ = ["SignError"]


class SignError(Effect):
    """A column has the wrong sign, in all runs (``"N"``) or in one (``"N@run"``)."""

    slug: ClassVar[str] = "sign-error"
    family: ClassVar[Family] = "bookkeeping"
    meaning: ClassVar[str] = "a column counts the other way: positive to port, upwards, or a plug turned round"
    shown_by: ClassVar[str] = "the simulation goes the opposite way at every command, or heading and rate disagree"
    mistaken_for: ClassVar[tuple[str, ...]] = ("channel-swap", "time-offset")
    separated_by: ClassVar[str] = "one long push to starboard (ahead, down) while somebody watches"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every signal, and every input whose sign the model does not fit anyway; with several runs also each alone."""
        columns = (*scene.signals, *(c for c in scene.inputs if not sign_is_free(c, scene.form)))
        # Of one run only, the sign of any input shows against the other runs.
        each = (*scene.signals, *scene.inputs) if len(scene.runs) > 1 else ()
        return (*columns, *(f"{c}@{run}" for c in each for run in scene.runs))

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Turn the command round."""
        (name,) = columns_of(own.place)
        if name not in drive.channels or not concerns(own.place, drive.run):
            return drive
        return drive.with_channel(name, -drive.channels[name])

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Turn the signal round."""
        (name,) = columns_of(own.place)
        if name not in seen.signals or not concerns(own.place, seen.run):
            return seen
        return seen.with_signal(name, -seen.signals[name])
