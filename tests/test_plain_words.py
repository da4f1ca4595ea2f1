"""A lint for visible texts: words that do not belong there, and sentences that are too long.

It reads the string literals of the packages in :data:`ROOMS` that look like sentences, and the text of their pages; a
``{placeholder}`` counts as one word. In docstrings and comments only the words are checked; quoted names are left out.
A new word for the table goes into :data:`WORDS`, with what to write instead.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ROOMS = (
    "gcs_autotune/*.py",
    "gcs_autotune/cli",
    "gcs_autotune/control",
    "gcs_autotune/crosscheck",
    "gcs_autotune/design",
    "gcs_autotune/diagnose",
    "gcs_autotune/effects",
    "gcs_autotune/experiments",
    "gcs_autotune/export",
    "gcs_autotune/firmware",
    "gcs_autotune/identify",
    "gcs_autotune/limits",
    "gcs_autotune/link",
    "gcs_autotune/logs",
    "gcs_autotune/manoeuvres",
    "gcs_autotune/mavlink",
    "gcs_autotune/models",
    "gcs_autotune/navigation",
    "gcs_autotune/report",
    "gcs_autotune/seatrials",
    "gcs_autotune/study",
    "gcs_autotune/thrusters",
    "gcs_autotune/vision",
    "gcs_autotune/web",
    "gcs_autotune/workflow",
    "gcs_autotune_files",
    "sitl",
    "benchmarks",
)
"""Packages whose texts are checked."""

WORDS = {
    r"tells?|told|telling": "report, show, identify, distinguish",
    r"says?|said": "report, show, state",
    r"foretells?|foretold": "predict",
    r"swings?|swung|swinging": "oscillate, oscillation",
    r"wanders?|wandering": "drift",
    r"weather": "process noise, disturbance",
    r"beneath": "with process noise modelled, below",
    r"anew": "again",
    r"besides": "also, in addition",
    r"meanwhile": "during the run",
    r"nobody|somebody": "the operator, no other station",
    r"her|hers|she|him|his": "it, its",
    r"wish(ed|es)?|wanted": "required, requested",
    r"come about|comes about|came about|turn-about": "turn around",
    r"way on|way off": "speed, headway",
    r"boarding": "connection",
    r"(put|puts|putting|given|gives|giving) (it |them |things |everything )?back": "restore",
    r"as found|as it was found|as they were found": "in the original state, restored",
    r"errs?": "the error is",
    r"pays?": "improves the prediction, is supported by",
    r"shares? of full": "normalised output, percent of full output",
    r"on board log|log on board": "onboard log",
    r"holds? (no|\d+|a) [a-z]+ (log|message|sample|run|parameter)s?": "contains no ...",
    r"(?<!there )is no (?!better|longer|more|less|worse)[a-z]+": "is not a ...",
    r"hears?|unheard": "receive, lose contact",
    r"[a-z]+\(s\)": "gcs_autotune.rounding.counted(number, noun)",
}
"""What a text must not contain -> what to write instead."""

LONGEST = 25
"""Words of a sentence at most; a placeholder, a number and a path are a word each."""

_PLACEHOLDER = "\u00a7"


def texts(pattern: str) -> Iterator[tuple[str, str]]:
    """Yield (place, text) of every sentence-like string literal in a package, without docstrings, and of its pages."""
    place = ROOT / pattern
    files = sorted(ROOT.glob(pattern)) if "*" in pattern else sorted(place.rglob("*.py"))
    for file in files:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        skipped = {id(s.value) for s in ast.walk(tree) if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)}
        skipped |= {id(v) for s in ast.walk(tree) if isinstance(s, ast.JoinedStr) for v in ast.walk(s) if v is not s}
        for node in ast.walk(tree):
            if id(node) in skipped:
                continue
            text = _text(node)
            if text.count(" ") >= 2 and "\n" not in text.strip():
                yield f"{file.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}", text
    for page in [] if "*" in pattern else sorted(place.rglob("*.html")):
        bare = re.sub(r"\{[{].*?[}]\}", _PLACEHOLDER, page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for text in re.split(r"<[^>]*>|\{[%#].*?[%#]\}", bare, flags=re.DOTALL):
            if text.strip().count(" ") >= 2:
                yield str(page.relative_to(ROOT)), " ".join(text.split())


QUOTED = re.compile(r"``[^`]*``|:[a-z]+:`[^`]*`|\*\w+\*|\"[^\"]*\"|^ *[\w, ]+ :|>>>.*", re.MULTILINE)
"""Names and quotations in a docstring or comment, and the names of its parameters."""


def remarks(pattern: str) -> Iterator[tuple[str, str]]:
    """Yield (place, text) of every docstring and comment in a package, without what they quote."""
    place = ROOT / pattern
    for file in sorted(ROOT.glob(pattern)) if "*" in pattern else sorted(place.rglob("*.py")):
        source = file.read_text(encoding="utf-8")
        found = [
            (node.lineno, node.value.value)
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        ]
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        found += [(token.start[0], token.string) for token in tokens if token.type == tokenize.COMMENT]
        for line, text in found:
            yield f"{file.relative_to(ROOT)}:{line}", QUOTED.sub("\u00a7", text)


def _text(node: ast.AST) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return re.sub(r"\{\w*\}", _PLACEHOLDER, node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else _PLACEHOLDER for v in node.values)
    return ""


def sentences(text: str) -> list[str]:
    """Return the sentences of a text: a stop, colon or semicolon before a blank ends one, as does a bracket."""
    return re.split(r"[.!?:;]\s|[()]", text)


def test_every_package_is_checked() -> None:
    packages = {f"gcs_autotune/{p.parent.name}" for p in (ROOT / "gcs_autotune").glob("*/__init__.py")}
    assert packages == {room for room in ROOMS if room.startswith("gcs_autotune/") and "*" not in room}


ANY_WORD = re.compile(rf"(?<![\w-])(?:{'|'.join(WORDS)})(?![\w-])", re.IGNORECASE)


def misused(text: str) -> list[str]:
    """Return what to change of the words of *text*."""
    if not ANY_WORD.search(text):
        return []
    found = ((re.search(rf"(?<![\w-])(?:{words})(?![\w-])", text, re.IGNORECASE), use) for words, use in WORDS.items())
    return [f"{match[0]!r}, write {use}" for match, use in found if match]


def too_long(text: str) -> list[str]:
    """Return the sentences of *text* that have too many words."""
    return [s for s in sentences(text) if len(s.split()) > LONGEST]


@pytest.mark.parametrize("room", ROOMS)
def test_texts_use_plain_words_and_short_sentences(room: str) -> None:
    found = []
    for place, text in texts(room):
        found += [f"{place}: {change}: {text}" for change in misused(text)]
        found += [f"{place}: too long: {sentence}" for sentence in too_long(text)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_and_comments_use_plain_words(room: str) -> None:
    found = [f"{place}: {change}: {text}" for place, text in remarks(room) for change in misused(text)]
    assert not found, "\n".join(found)


def test_the_lint_itself_finds_a_word_and_a_long_sentence() -> None:
    assert misused("the log tells no speed") == ["'tells', write report, show, identify, distinguish"]
    assert misused("1 gap(s) in the run") == ["'gap(s)', write gcs_autotune.rounding.counted(number, noun)"]
    assert misused("Check the sensor: the log contains no speed. A teller is a person.") == []
    assert too_long(" ".join(["word"] * LONGEST)) == []
    assert too_long(" ".join(["word"] * (LONGEST + 1)))
    assert {place.partition(":")[0] for place, _ in texts("gcs_autotune/limits")} >= {"gcs_autotune/limits/safety.py"}
