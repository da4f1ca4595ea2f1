"""Results as JSON that every reader takes: a number that is not known is null, never NaN, which JSON does not have."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["json_text", "plain_data"]


def plain_data(thing: Any) -> Any:
    """Return *thing* in JSON's own types: NumPy's numbers and arrays plain, null for what is not finite, else words."""
    if hasattr(thing, "tolist"):  # NumPy's, which need not be imported for it
        thing = thing.tolist()
    if isinstance(thing, Mapping):
        return {str(key): plain_data(value) for key, value in thing.items()}
    if isinstance(thing, Sequence) and not isinstance(thing, str):
        return [plain_data(value) for value in thing]
    if isinstance(thing, float):
        return float(thing) if math.isfinite(thing) else None
    return thing if isinstance(thing, str | int | bool | None) else str(thing)


def json_text(thing: Any) -> str:
    """Return *thing* as the text of a JSON file, by :func:`plain_data`."""
    return json.dumps(plain_data(thing), indent=1, allow_nan=False) + "\n"
