"""A page read strictly: every element is closed in order; and the contents of the page."""

from __future__ import annotations

import re
from html.parser import HTMLParser

from gcs_autotune.report.toolkit.chart import chart_script

VOID = {"meta", "link", "br", "hr", "img", "input", "path", "use", "rect", "wbr"}


class Page(HTMLParser):
    """Checks that every element is closed in order, and collects what the page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "action", "data", "poster", "srcset"):
                self.references.append(value)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
            self.open.pop()

    def handle_data(self, data):
        (self.scripts if self.open and self.open[-1] == "script" else self.words).append(data)

    @property
    def runs_only_ours(self) -> bool:
        """Whether the page has no script but that of its charts, if any."""
        return self.scripts in ([], [chart_script()]) and self.tags.count("script") == len(self.scripts)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words).replace("\u00a0", " "))
