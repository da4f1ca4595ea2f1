"""A lint for the documents: the words of tests/test_plain_words.py, sentences, paragraphs and table cells."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_plain_words import misused, sentences

ROOT = Path(__file__).parents[1]
FOLDERS = (
    "*.md",
    "docs/*.md",
    "docs/tutorials/*.md",
    "docs/decisions/*.md",
    "docs/reference/formats.md",
    "benchmarks/**/*.md",
    "extension/*.md",
)
PAGES = sorted({p.relative_to(ROOT).as_posix() for folder in FOLDERS for p in ROOT.glob(folder)})
LONGEST = 25
"""Words of a sentence at most; code and a link count as one word each."""
MOST_LINES = 5
"""Lines of a paragraph at most."""
CELL = 120
"""Characters of a table cell at most, links' targets left out."""


QUOTED = re.compile(r"^<!-- case .*?^<!-- end -->$", re.MULTILINE | re.DOTALL)
"""A block written by a benchmark: it quotes the program as it was at the commit measured."""


def prose(text: str) -> str:
    """Return *text* without blocks of code and of a benchmark; inline code and links become one word each."""
    text = QUOTED.sub("", text)
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^<!--.*?-->$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "CODE", text)
    return re.sub(r"\*+(?=\S)|(?<=\S)\*+", "", text)  # emphasis, but not the star of a list


def blocks(text: str) -> list[str]:
    """Return paragraphs, list items and table cells of prose, each on one line."""
    found = []
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[*:-]|\d+\.|#+) )", text):
        if part.lstrip().startswith("|"):
            found += [cell.strip() for row in part.split("\n") for cell in row.split("|")]
        else:
            found.append(" ".join(part.split()))
    return [block for block in found if block]


@pytest.mark.parametrize("page", PAGES)
def test_documents_use_plain_words_in_short_sentences(page: str) -> None:
    found = blocks(prose((ROOT / page).read_text(encoding="utf-8")))
    wrong = [f"{change}: {block[:100]}" for block in found for change in misused(block)]
    wrong += [f"too long: {s}" for block in found for s in sentences(block) if len(s.split()) > LONGEST]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("page", PAGES)
def test_paragraphs_and_cells_are_short(page: str) -> None:
    text = QUOTED.sub("", (ROOT / page).read_text(encoding="utf-8"))
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    parts = [
        p for p in re.split(r"\n\s*\n|\n(?=\s*(?:[*:-]|\d+\.|#+) )", text) if not p.lstrip().startswith(("|", "<!--"))
    ]
    long = [p for p in parts if len(p.strip().split("\n")) > MOST_LINES]
    cells = [cell for row in prose(text).split("\n") if row.startswith("|") for cell in row.split("|")]
    assert not long + [c for c in cells if len(c) > CELL]


def test_the_lint_itself_finds_a_word_a_long_sentence_and_skips_code() -> None:
    assert blocks(prose("A `log tells` it.\n\n```sh\ntells\n```\n* **One.** two\n* three\n\n| a | b |\n")) == [
        "A CODE it.",
        "* One. two",
        "* three",
        "a",
        "b",
    ]
    assert misused("the log tells it")
    assert "docs/tune.md" in PAGES
