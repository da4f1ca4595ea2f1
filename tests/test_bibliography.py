"""Sources are cited by key, and every key is in docs/references.bib."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
BIBLIOGRAPHY = ROOT / "docs" / "references.bib"
READ = frozenset({".py", ".toml", ".md", ".html", ".txt"})
KEY = re.compile(r"\b([A-Z][A-Za-z]+(?:19|20)\d\d)\b|\b(ZhaoUSV)\b")
NOT_CITED = frozenset({"CITATION"})


def entries() -> list[str]:
    return re.findall(r"^@\w+\{(\w+),", BIBLIOGRAPHY.read_text(encoding="utf-8"), re.MULTILINE)


def texts() -> Iterator[tuple[Path, str]]:
    for top in ("gcs_autotune", "sitl", "benchmarks", "docs", "tests"):
        for path in sorted((ROOT / top).rglob("*")):
            made = "_build" in path.parts or path.name == "bibliography.md"
            if path.suffix in READ and path != Path(__file__) and not made:
                yield path.relative_to(ROOT), path.read_text(encoding="utf-8")


def cited() -> dict[str, Path]:
    return {a or b: path for path, text in texts() for a, b in KEY.findall(text)}


def test_every_cited_key_is_in_the_bibliography() -> None:
    unknown = {key: path for key, path in cited().items() if key not in entries()}
    assert not unknown


def test_every_entry_of_the_bibliography_is_cited_and_unique() -> None:
    keys = entries()
    assert len(keys) > 40
    assert len(set(keys)) == len(keys)
    assert not set(keys) - set(cited())


def test_every_entry_has_author_title_and_year_or_note() -> None:
    for line in BIBLIOGRAPHY.read_text(encoding="utf-8").splitlines():
        if line.startswith("@"):
            assert all(f"{field} = {{" in line for field in ("author", "title")), line
            assert "year = {" in line or "note = {" in line, line
    assert len(entries()) > 40


def test_no_source_is_cited_by_a_private_name() -> None:
    private = re.compile(r"\b[Ss]eed 00\d|\b[Tt]hesis,? [(\d]|\bthe thesis\b")
    assert not [(path, found.group()) for path, text in texts() for found in private.finditer(text)]
