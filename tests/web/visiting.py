"""The page in a browser, for tests that view and operate it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import reduce
from typing import Any
from urllib.parse import urlsplit

LONG = 200_000.0
"""Milliseconds that a run may take on a busy machine."""


class Page:
    """A page that remembers what went wrong on it and whom it called."""

    def __init__(self, browser: Any, link: str, *, wait: bool = True, **context: Any) -> None:
        self.ending = ExitStack()
        """What is open for as long as the page is."""
        self.context = self.ending.enter_context(browser.new_context(**context))
        self.context.set_default_timeout(LONG)
        self.page = self.context.new_page()
        self.troubles: list[str] = []
        self.called: set[str] = set()
        self.page.on("console", lambda m: m.type == "error" and self.troubles.append(m.text))
        self.page.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.page.on("request", lambda request: self.called.add(urlsplit(request.url).netloc))
        self.page.on("websocket", lambda socket: self.called.add(urlsplit(socket.url).netloc))
        self.link = link
        self.page.goto(link)
        self.is_up() if wait else None

    def is_up(self) -> None:
        """Wait until the page has heard from its server, which has no run or one that is over."""
        self.page.locator("#stage", has_text="No run").or_(self.page.locator("#stage", has_text="over")).wait_for()

    def shows(self, selector: str, text: str, timeout: float = LONG) -> None:
        self.shows_one_of(((selector, text),), timeout)

    def shows_one_of(self, wanted: Sequence[tuple[str, str]], timeout: float = LONG) -> None:
        """Wait until one of the selectors shows its text."""
        first, *others = [self.page.locator(selector, has_text=text).first for selector, text in wanted]
        try:
            reduce(lambda one, other: one.or_(other), others, first).first.wait_for(timeout=timeout)
        except Exception as error:  # Playwright's own TimeoutError, which is none of Python's
            values = {
                name: self.page.text_content(f"#{name}") for name in ("stage", "end-title", "end-reason", "words")
            }
            raise AssertionError(f"none of {wanted} is ever shown; the page says {values}") from error

    def start(self, *, dry: bool = False, **fields: str) -> None:
        self.page.click("#tab-start")
        for name, value in {"job": "tune", **fields}.items():
            if name.startswith("n-"):
                self.page.eval_on_selector(f"#{name}", "input => { input.closest('details').open = true; }")
            chosen = name in ("job", "style", "axis", "manoeuvre", "force", "first-to", "model")
            (self.page.select_option if chosen else self.page.fill)(f"#{name}", value)
        self.page.locator("#dry").set_checked(dry) if dry else None
        self.page.click("#start")

    def stopped(self) -> str:
        """Wait for the end after STOP and return the restored values."""
        self.shows("#end-title", "stopped by the operator")
        return str(self.page.inner_text("#put-back"))
