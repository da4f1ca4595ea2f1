"""Results are never overwritten silently."""

from __future__ import annotations

import argparse
import io
import re
from datetime import datetime
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.cli.command import run_directory
from gcs_autotune.cli.writing import fresh, in_plain_signs, on_replacing, write_page
from gcs_autotune.report import Document


def record(path: Path) -> Path:
    """A run of 2 r' + r = N from rest, without noise, with random steps."""
    t, dt = np.arange(0.0, 30.0, 0.1), 0.1
    N = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 15), 20)
    psi, r = np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t) - 1):
        psi[k + 1] = psi[k] + N[k] * dt + (r[k] - N[k]) * 2.0 * (1.0 - np.exp(-dt / 2.0))
        r[k + 1] = N[k] + (r[k] - N[k]) * np.exp(-dt / 2.0)
    noise = np.random.default_rng(2).normal(0.0, 0.002, len(t))
    rows = np.column_stack([t, psi + noise, N])
    np.savetxt(path, rows, delimiter=",", header="t[s],psi[rad],N[N m]", comments="", fmt="%.6f")
    return path


def test_a_name_in_use_gets_the_next_number(tmp_path: Path) -> None:
    page = tmp_path / "identify-Z_10_05.html"
    names = []
    for _ in range(3):
        path = fresh(page)
        path.write_text("kept", encoding="utf-8")
        names.append(path.name)
    assert names == ["identify-Z_10_05.html", "identify-Z_10_05-2.html", "identify-Z_10_05-3.html"]


def test_files_that_would_be_replaced_are_reported_and_an_empty_folder_is_not(tmp_path: Path) -> None:
    file, folder = tmp_path / "a.html", tmp_path / "out"
    folder.mkdir()
    assert (on_replacing(file), on_replacing(folder)) == ("", "")
    file.write_text("earlier", encoding="utf-8")
    (folder / "report.html").write_text("earlier", encoding="utf-8")
    assert "replaced" in on_replacing(file)
    assert "replaced" in on_replacing(folder)


def test_identifying_twice_writes_two_pages(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = record(tmp_path / "Z_10_05.csv")
    once = ["identify", str(run), "--no-check", "--structure", "linear"]
    assert main(once) == main(once) == 0
    assert {p.name for p in tmp_path.glob("*.html")} == {"identify-Z_10_05.html", "identify-Z_10_05-2.html"}
    assert "Report: identify-Z_10_05-2.html\n" in capsys.readouterr().out
    assert main([*once, "--page", "identify-Z_10_05.html"]) == 0
    assert "Report: identify-Z_10_05.html (replaced an earlier file)" in capsys.readouterr().out


def test_two_runs_begun_in_the_same_second_have_separate_directories(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    args, now = argparse.Namespace(out=None, axis="heading"), datetime(2026, 11, 22, 20, 30)
    first = run_directory(args, "sitl:charlie", now)
    first.mkdir(parents=True)
    assert run_directory(args, "sitl:charlie", now).name == f"{first.name}-2"


def test_a_terminal_without_utf_8_gets_words_for_unsupported_symbols() -> None:
    for encoding, wanted in (("ascii", "30 deg +- 2 s^2 ?"), ("latin-1", "30° ± 2 s² ?"), ("utf-8", "30° ± 2 s² ψ")):
        stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
        in_plain_signs(stream)
        stream.write("30° ± 2 s² ψ")
        stream.flush()
        assert stream.buffer.getvalue().decode(encoding) == wanted


def test_a_page_links_its_sources_relative_to_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pages").mkdir()
    run = tmp_path / "runs" / "lake 1#2"
    (run / "trials").mkdir(parents=True)
    record(run / "trials" / "01-relay.csv")
    for name in ("model.json", "report.html"):
        (run / name).write_text("{}")
    page = tmp_path / "pages" / "identify.html"
    words = ["--dof=yaw", "--page=pages/identify.html", "--save=pages/model.json", "--quiet"]
    assert main(["identify", "runs/lake 1#2/trials/01-relay.csv", *words]) == 0
    assert files_of(page) == [run / "trials" / "01-relay.csv", tmp_path / "pages" / "model.json"]
    write_page(Document("Comparison", ()), run / "compared.html", run, page)
    assert files_of(run / "compared.html") == [
        run / "report.html",
        run / "model.json",
        run / "trials" / "01-relay.csv",
        page,
    ]


def files_of(page: Path) -> list[Path]:
    """The files that a page links, each of which is there."""
    (section,) = re.findall(r"<summary>Files of this report.*?</details>", page.read_text(encoding="utf-8"), re.DOTALL)
    links = re.findall(r'href="([^"#][^"]*)"', section)
    files = [Path(unquote(urlsplit(urljoin(page.as_uri(), link)).path)) for link in links]
    assert all(file.is_file() for file in files)
    return files
