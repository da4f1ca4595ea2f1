"""Servers of the page that the tests of a session share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from .serving import served


@pytest.fixture(scope="session")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The link of a server whose runs are a script: they say, ask and stop at once."""
    with served(tmp_path_factory.mktemp("runs"), scripted=True) as link:
        yield link


@pytest.fixture(scope="session")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """The link of a server whose runs fly simulated vehicles, and its folder of runs."""
    runs = tmp_path_factory.mktemp("flown")
    with served(runs, scripted=False) as link:
        yield link, runs
