"""The book of effects: submodels that extend a plain simulation, one file each.

==========  ======================================================================
effect      what an effect is: its hooks, and what they are given
book        the table of all effects
extended    a coupled model with effects: simulation with sensitivities, model file
==========  ======================================================================
"""

from __future__ import annotations

from gcs_autotune.effects.book import BOOK
from gcs_autotune.effects.effect import Applied, Effect, Scene

__all__ = ["BOOK", "Applied", "Effect", "Scene"]
