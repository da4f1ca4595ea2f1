"""Cheaper pages, for tests of their words."""

from __future__ import annotations

import pytest

from gcs_autotune.report.toolkit import page


@pytest.fixture
def words_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Omit the figures, nearly all of the time of a page, from the pages of a test that reads none."""
    monkeypatch.setattr(page, "drawn", lambda figure: iter(()))
