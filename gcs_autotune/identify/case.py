"""What every identification method is handed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.axis.form import Structure, axis_form
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.result import Doubt, LimitCycle
from gcs_autotune.identify.segment import Segment
from gcs_autotune.models import Form
from gcs_autotune.trial import Trial

__all__ = ["Case"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Case:
    """One question: these stretches of runs, this form, what to assume.

    ``form`` None: one degree of freedom, of damping ``structure`` (None: decide). ``delay`` None: fit one if there is
    strong evidence. ``use`` None: choose the signals. ``robust``: soft-L1 weights. ``names`` and ``trials``: the runs
    as given; ``cycles``: the limit cycles in them; ``dropped_rows`` in the files they came from; ``notes``: what is
    doubtful about the runs. ``effects`` to be fitted with the form, from the model ``start`` on if one is given.
    ``options``: what the method alone understands.
    """

    records: tuple[Segment, ...]
    names: tuple[str, ...]
    form: Form | None = None
    structure: Structure | None = None
    delay: float | None = None
    use: tuple[str, ...] | None = None
    robust: bool = False
    trials: tuple[Trial, ...] = ()
    cycles: tuple[LimitCycle, ...] = ()
    dropped_rows: int = 0
    notes: tuple[Doubt, ...] = ()
    effects: tuple[EffectSpec, ...] = ()
    start: ExtendedModel | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def the_form(self) -> Form:
        """The form.

        Raises
        ------
        UsageError
            One degree of freedom was asked for: see :meth:`as_form`.
        """
        if self.form is None:
            raise UsageError("this method fits a form: give one, or a structure of damping")
        return self.form

    def as_form(self, structure: Structure) -> Case:
        """Return the question about one degree of freedom as one about its form; an unknown delay is none."""
        first, delay = self.records[0], self.delay or 0.0
        form = axis_form(
            first.dof, first.input_names[0], structure, normalised=first.input_units[0] == "1", delay=delay
        )
        return replace(self, form=form, delay=delay, records=tuple(self._used(r) for r in self.records))

    def _used(self, segment: Segment) -> Segment:
        """Return *segment* with the signals asked for, by name or as ``position`` and ``velocity``."""
        kinds = {segment.dof.position: "position", segment.dof.velocity: "velocity"}
        return segment.only([n for n in segment.signals if not self.use or kinds[n] in self.use or n in self.use])

    @property
    def input_units(self) -> dict[str, str]:
        """Unit of every input of the form."""
        return dict(zip(self.the_form.inputs, self.records[0].input_units, strict=True))

    @property
    def all_notes(self) -> tuple[Doubt, ...]:
        """What is doubtful about the runs, then about their stretches."""
        return (*self.notes, *(doubt for record in self.records for doubt in record.notes))

    @property
    def largest(self) -> dict[str, float]:
        """The largest input of all runs, by its name."""
        return {self.records[0].input_names[0]: max(float(np.max(np.abs(r.tau))) for r in self.records)}

    @property
    def relay_flown(self) -> bool:
        """Whether a relay was flown: a zig-zag by hand also switches at two headings, but nobody ran a relay there."""
        return any(t.by_relay for t in self.trials)

    @property
    def cut_short(self) -> bool:
        """Whether a relay was ended on purpose, as enough was known: it has few periods, and need not have settled."""
        return any(t.by_relay and bool(t.meta.get("enough")) for t in self.trials)

    @property
    def more_levels(self) -> str:
        """What to do so that kinds of damping, or damping and delay, can be told apart."""
        if self.relay_flown:
            return "fly a second relay with a clearly different C"
        return "record a run with clearly larger or smaller inputs as well"
