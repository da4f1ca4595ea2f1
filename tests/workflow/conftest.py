"""Cheaper whole jobs, for tests of what happens on the way."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module", autouse=True)
def with_brief_designs(briefly: None) -> None:
    """The command at its full length is flown in ``tests/cli/test_command_line.py``."""


@pytest.fixture
def plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the gains as matched, without refining them, and leave the pictures out of the report."""
    taken_plainly(monkeypatch)


def taken_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do as :func:`plainly`."""
    monkeypatch.setattr("gcs_autotune.design.proposal.refine", lambda problem, chosen, duration: chosen)
    monkeypatch.setattr("gcs_autotune.report.tune.page.draw_pictures", lambda story: ())
