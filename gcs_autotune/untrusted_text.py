"""Make untrusted text (from a vehicle or a file) safe to show: no control character reaches a terminal.

Terminals execute escape sequences, which clear the screen, move the cursor or retitle the window. A vehicle's message
or a column name could forge our output. Characters that change the writing direction can do the same on a page.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

__all__ = ["quoted", "visible"]

_ACTIVE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories of invisible characters with an effect.

C0 and C1 controls, bidirectional overrides and other format characters, surrogates, line and paragraph separators.
"""
MOST_SHOWN = 3
"""Number of vehicle messages shown at once, because it may send hundreds a second. Project choice."""
LONGEST = 200
"""Number of characters shown of one message. A STATUSTEXT has 50, in pieces many thousand. Project choice."""


def visible(text: str, keep: str = "") -> str:
    """Return *text* with every control character written as its escape (``\\x1b``), except those in *keep*."""
    if text.isascii() and text.isprintable():
        return text
    active = (c for c in set(text) if c not in keep and unicodedata.category(c) in _ACTIVE)
    return text.translate({ord(c): c.encode("unicode_escape").decode() for c in active})


def quoted(texts: Iterable[str]) -> str:
    """Return untrusted sentences in quotation marks: each once, only the last few, each shortened."""
    found = list(dict.fromkeys(visible(text).replace('"', "'") for text in texts))
    shown = [f'"{text if len(text) <= LONGEST else text[:LONGEST] + "..."}"' for text in found[-MOST_SHOWN:]]
    more = len(found) - len(shown)
    return "; ".join(shown) + (f" and {more} more before" if more else "")
