"""Hidden effects: what may stand between the autopilot and the ideal sea. None is built in.

``effect`` is the contract, ``table`` says which there are, the other files hold them by family.
"""

from sitl.effects.effect import BadEffect, EffectParameter, HiddenEffect, Setting
from sitl.effects.table import EFFECTS, make_effect, parse_effect

__all__ = ["EFFECTS", "BadEffect", "EffectParameter", "HiddenEffect", "Setting", "make_effect", "parse_effect"]
