"""What a method for coupled models is handed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gcs_autotune.identify.segment import Segment
from gcs_autotune.models import Form
from gcs_autotune.trial import Trial

__all__ = ["CoupledCase"]


@dataclass(frozen=True, slots=True, eq=False)
class CoupledCase:
    """One question: this form, these stretches, what to assume.

    ``delay`` None: fit one if there is strong evidence. ``robust``: soft-L1 weights. ``names`` and ``trials``: the
    runs as given; ``options``: what the method alone understands.
    """

    form: Form
    records: tuple[Segment, ...]
    delay: float | None
    robust: bool
    names: tuple[str, ...]
    trials: tuple[Trial, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
