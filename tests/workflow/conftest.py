"""Cheaper whole jobs, for tests of what happens on the way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gcs_autotune.report.flight import page as flight_page
from gcs_autotune.report.tune import page as tune_page


@pytest.fixture(scope="module", autouse=True)
def with_brief_designs(briefly: None) -> None:
    """The command at its full length is flown in ``tests/cli/test_command_line.py``."""


DRAWN = ((tune_page, "draw_pictures"), (flight_page, "_signals"), (flight_page, "_fits"), (flight_page, "_tracks"))
DRAW = tuple(getattr(page, name) for page, name in DRAWN)


@pytest.fixture(scope="module", autouse=True)
def without_pictures() -> Iterator[None]:
    """Leave the pictures out of reports, a quarter of many a job, but where a file looks at them and says so."""
    with pytest.MonkeyPatch.context() as patch:
        for page, name in DRAWN:
            patch.setattr(page, name, lambda *story, **how: [])
        yield


@contextmanager
def with_pictures() -> Iterator[None]:
    """Draw them meanwhile: one page of the file is looked at."""
    with pytest.MonkeyPatch.context() as patch:
        for (page, name), draw in zip(DRAWN, DRAW, strict=True):
            patch.setattr(page, name, draw)
        yield


@pytest.fixture
def plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the gains as matched, without refining them."""
    taken_plainly(monkeypatch)


def taken_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do as :func:`plainly`."""
    for name in ("refine", "refine_briefly"):
        monkeypatch.setattr(f"gcs_autotune.design.proposal.{name}", lambda problem, chosen, duration, **how: chosen)
