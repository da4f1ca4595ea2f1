"""What every room's tests may use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="session")
def published() -> dict[str, Any]:
    """The published tables, kept beside the repository."""
    path = Path(__file__).parents[1] / ".." / "shared" / "data" / "published_tables.json"
    if not path.exists():
        pytest.skip("published_tables.json is not beside the repository (../shared/data)")
    return dict(json.loads(path.read_text(encoding="utf-8")))
