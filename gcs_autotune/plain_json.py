"""Write results as JSON that every reader accepts. Unknown numbers are null, because JSON has no NaN."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["json_text", "plain_data"]


def plain_data(thing: Any) -> Any:
    """Return *thing* in JSON's own types: NumPy's numbers and arrays as plain ones, null for a number that is not
    finite, else text."""
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
    """Return *thing* as the text of a JSON file, converted by :func:`plain_data`."""
    return json.dumps(plain_data(thing), indent=1, allow_nan=False) + "\n"
