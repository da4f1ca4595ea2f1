"""Cheaper whole jobs, for tests of what happens on the way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gcs_autotune.report.toolkit import page


@pytest.fixture(scope="module", autouse=True)
def with_brief_designs(briefly: None) -> None:
    """The command at its full length is flown in ``tests/cli/test_command_line.py``."""


DRAWN = page.drawn


@pytest.fixture(scope="module", autouse=True)
def without_pictures() -> Iterator[None]:
    """Omit the figures from reports, a quarter of the time of many a job, except in files that check them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "drawn", lambda figure: iter(()))
        yield


@contextmanager
def with_pictures() -> Iterator[None]:
    """Plot them meanwhile: one page of the file is checked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "drawn", DRAWN)
        yield


@pytest.fixture
def plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the gains as matched, without refining them."""
    taken_plainly(monkeypatch)


def taken_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do as :func:`plainly`."""
    for name in ("refine", "refine_briefly"):
        monkeypatch.setattr(f"gcs_autotune.design.proposal.{name}", lambda problem, chosen, duration, **how: chosen)
