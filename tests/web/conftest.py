"""Servers of the page that the tests of a session share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from .serving import served
from .visiting import Page


@pytest.fixture(scope="session")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The link of a server with scripted runs, which print, prompt and stop at once."""
    with served(tmp_path_factory.mktemp("runs"), scripted=True) as link:
        yield link


@pytest.fixture(scope="session")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """The link of a server whose runs fly simulated vehicles, and its folder of runs."""
    runs = tmp_path_factory.mktemp("flown")
    with served(runs, scripted=False) as link:
        yield link, runs


@pytest.fixture
def visit(browser: Any) -> Iterator[Any]:
    """Open pages; none may log an error, or call anything but the server."""
    pages: list[Page] = []

    def opened(link: str, **context: Any) -> Page:
        pages.append(Page(browser, link, **context))
        return pages[-1]

    yield opened
    for page in pages:
        page.ending.close()
        assert page.troubles == []
        assert page.called == {urlsplit(page.link).netloc}
