"""A coupled model with effects applied: what a diagnosis ends with, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.book import BOOK
from gcs_autotune.effects.effect import Applied
from gcs_autotune.effects.simulator import ExtendedSimulator, Passage, in_order
from gcs_autotune.errors import BadFile
from gcs_autotune.models.coupled import CoupledModel
from gcs_autotune.registry import lookup

__all__ = ["SCHEMA", "ExtendedModel"]

Array = NDArray[np.float64]

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ExtendedModel:
    """A coupled model and the effects that stand between it and the measurements, in the book's order.

    ``swing``: what "full" of each input means to whoever flies it (:attr:`.effect.Scene.full`);
    ``units`` of the inputs ("1": fractions of full output). Both empty when nobody said.
    """

    base: CoupledModel
    effects: tuple[Applied, ...] = ()
    swing: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for a model file."""
        return {
            "schema": SCHEMA,
            "model": "extended",
            "base": self.base.to_dict(),
            "effects": [e.to_dict() for e in self.effects],
            "constants": {"swing": dict(self.swing), "units": dict(self.units)},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ExtendedModel:
        """Rebuild from :meth:`to_dict`, or from a plain coupled model's data.

        Raises
        ------
        BadFile
            Something is missing or of the wrong kind. UnknownName: an effect that is not in the book.
        """
        try:
            if data.get("model") == "coupled":
                return cls(CoupledModel.from_dict(data))
            effects = tuple(
                Applied(
                    str(e["slug"]),
                    str(e["place"]),
                    {str(k): float(v) for k, v in e["values"].items()},
                    {str(k): float(v) for k, v in e.get("constants", {}).items()},
                )
                for e in data["effects"]
            )
            base = CoupledModel.from_dict(data["base"])
            constants = data.get("constants", {})
            swing = {str(k): float(v) for k, v in constants.get("swing", {}).items()}
            units = {str(k): str(v) for k, v in constants.get("units", {}).items()}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BadFile(f"not a model file with effects: {error!r}") from error
        for effect in effects:
            lookup(BOOK, effect.slug, "effect")
        return cls(base, in_order(effects), swing, units)

    def predict(self, passage: Passage, initial: Mapping[str, float]) -> dict[str, Array] | None:
        """Return every signal at its own stamps from *initial* states (0 where not given); None if it runs away."""
        simulator = ExtendedSimulator(self.base.form, self.effects)
        x_0 = np.array([initial.get(n, 0.0) for n in simulator.states])
        found = simulator.run(self.base.theta, self.effects, x_0, passage)
        return None if found is None else {n: y for n, (y, _) in found.items()}
