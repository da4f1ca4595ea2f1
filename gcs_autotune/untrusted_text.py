"""Text that is not ours (a vehicle's, a file's), made fit to be shown: no control character of it reaches a terminal.

A terminal obeys escape sequences: they clear the screen, move the cursor, retitle the window. Left raw, a vehicle's
message or a column's name could write our own verdict. Characters that turn the direction of writing do so on a page.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

__all__ = ["quoted", "visible"]

_ACTIVE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's categories of characters that act and are not seen: C0 and C1 controls, bidirectional overrides and other
format characters, halves of surrogate pairs, line and paragraph separators."""
MOST_SHOWN = 3
"""Chosen: sentences of a vehicle shown at once; it may send hundreds a second."""
LONGEST = 200
"""Chosen: characters shown of one; a STATUSTEXT has 50, in pieces many thousand."""


def visible(text: str, keep: str = "") -> str:
    """Return *text* with every character that acts written as its escape (``\\x1b``), but for those in *keep*."""
    if text.isascii() and text.isprintable():
        return text
    active = (c for c in set(text) if c not in keep and unicodedata.category(c) in _ACTIVE)
    return text.translate({ord(c): c.encode("unicode_escape").decode() for c in active})


def quoted(texts: Iterable[str]) -> str:
    """Return sentences of somebody else as his words: each once, in quotation marks, the last few, none endless."""
    found = list(dict.fromkeys(visible(text).replace('"', "'") for text in texts))
    shown = [f'"{text if len(text) <= LONGEST else text[:LONGEST] + "..."}"' for text in found[-MOST_SHOWN:]]
    more = len(found) - len(shown)
    return "; ".join(shown) + (f" and {more} more before" if more else "")
