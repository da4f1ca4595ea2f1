"""JSON that every parser accepts."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from gcs_autotune.plain_json import json_text


def test_unknown_values_are_null_at_any_depth_and_numpy_values_are_plain() -> None:
    thing = {
        "a": [math.nan, (1.5, math.inf)],
        2: {"b": np.float64("nan"), "c": np.array([1.0, np.nan])},
        "d": np.int64(3),
    }
    text = json_text({**thing, "e": None, "f": True, "g": Path("x"), "h": np.bool_(False)})
    assert "NaN" not in text and "Infinity" not in text
    read = {
        "a": [None, [1.5, None]],
        "2": {"b": None, "c": [1.0, None]},
        "d": 3,
        "e": None,
        "f": True,
        "g": "x",
        "h": False,
    }
    assert json.loads(text) == read
    assert text.endswith("}\n")
