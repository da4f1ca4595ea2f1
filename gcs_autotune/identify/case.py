"""Input that every identification method receives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import UsageError
from gcs_autotune.identify.axis.form import Structure, axis_form
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.result import LimitCycle
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form
from gcs_autotune.trial import Trial

__all__ = ["Case"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Case:
    """One identification task: segments of runs, a form, and assumptions.

    - ``names``, ``trials``: the runs as supplied.
    - ``records``: the segments of the runs.
    - ``form``: the form to fit; None for one degree of freedom.
    - ``structure``: damping of one degree of freedom; None to choose one.
    - ``delay`` [s]: known delay; None to fit one and keep it only on strong evidence.
    - ``use``: signals to fit, None to choose them.
    - ``robust``: whether to use soft-L1 weights.
    - ``cycles``: limit cycles of the runs.
    - ``dropped_rows``: number of rows dropped from the run files.
    - ``notes``: doubts about the runs.
    - ``effects``: effects to fit with the form.
    - ``start``: model to start from, if any.
    - ``options``: keyword arguments for the method only.
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
        """Form to fit.

        Raises
        ------
        UsageError
            The task is for one degree of freedom and has no form; see :meth:`as_form`.
        """
        if self.form is None:
            raise UsageError("this method needs a form or a damping structure. Supply one of them")
        return self.form

    def as_form(self, structure: Structure, *, fits_delay: bool = False) -> Case:
        """Return this task of one degree of freedom as a task with a form of the drag *structure*.

        fits_delay : whether the method fits an unknown delay. Otherwise it is set to 0.
        """
        first, delay = self.records[0], self.delay if fits_delay else self.delay or 0.0
        form = axis_form(
            first.dof, first.input_names[0], structure, normalised=first.input_units[0] == "1", delay=delay or 0.0
        )
        return replace(self, form=form, delay=delay, records=tuple(self._used(r) for r in self.records))

    def _used(self, segment: Segment) -> Segment:
        """Return *segment* with only the signals chosen by ``use`` (names, ``position`` or ``velocity``)."""
        kinds = {segment.dof.position: "position", segment.dof.velocity: "velocity"}
        return segment.only([n for n in segment.signals if not self.use or kinds[n] in self.use or n in self.use])

    @property
    def input_units(self) -> dict[str, str]:
        """Unit of every input of the form, by name."""
        return dict(zip(self.the_form.inputs, self.records[0].input_units, strict=True))

    @property
    def all_notes(self) -> tuple[Doubt, ...]:
        """Doubts about the runs, followed by doubts about their segments."""
        return (*self.notes, *(doubt for record in self.records for doubt in record.notes))

    @property
    def largest(self) -> dict[str, float]:
        """Name of the input -> its largest magnitude in all runs. Only the first input is included."""
        return {self.records[0].input_names[0]: max(float(np.max(np.abs(r.tau))) for r in self.records)}

    @property
    def relay_flown(self) -> bool:
        """Whether a relay was flown.

        A manual zig-zag also switches at two headings, but is not a relay.
        """
        return any(t.by_relay for t in self.trials)

    @property
    def cut_short(self) -> bool:
        """Whether a relay experiment was ended early because its estimate was already accurate enough.

        Such an experiment has few periods and may not have settled.
        """
        return any(t.by_relay and bool(t.meta.get("enough")) for t in self.trials)

    @property
    def more_levels(self) -> str:
        """Advice to the user: which further run distinguishes kinds of damping, or damping from delay."""
        if self.relay_flown:
            return "fly a second relay with a clearly different output C"
        return "record a run with clearly larger or smaller inputs as well"
