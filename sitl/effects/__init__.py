"""Hidden effects: deviations between the autopilot and an ideal vehicle. None is active by default.

``effect`` is the interface and ``table`` lists the effects. The other modules contain the effects, one family each.
"""

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.table import EFFECTS, SURROUNDINGS, make_effect, parse_effect

__all__ = [
    "EFFECTS",
    "SURROUNDINGS",
    "BadEffect",
    "EffectParameter",
    "HiddenEffect",
    "Setting",
    "make_effect",
    "parse_effect",
]
