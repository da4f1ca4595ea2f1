"""Foreign text never acts on a terminal or a page, by any route."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from report_stories import kept, page_of
from rich.console import Console

from gcs_autotune.cli import main
from gcs_autotune.cli.console import ConsoleOperator
from gcs_autotune.mavlink import TextLog
from gcs_autotune.observer import Progress
from gcs_autotune.report import Document, StageBar, TerminalObserver
from gcs_autotune.report.toolkit.canvas import new_axes, pens, to_svg
from gcs_autotune.report.toolkit.document import Note, Remark, Section, Table, Verdict
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.untrusted_text import quoted, visible

FORGED = "ok\x1b]0;owned\x07\x1b[2J\r\n\x9b31mkept, all is well\u202e\u2028\x7f\u200b"
ACTING = "\x1b\x07\r\x9b\u202e\u2028\x7f\u200b"


def is_escaped(text: str) -> bool:
    return not any(c in text for c in ACTING)


def test_every_control_character_is_shown_as_its_escape_and_other_text_is_unchanged():
    assert visible(FORGED) == (r"ok\x1b]0;owned\x07\x1b[2J\r\n\x9b31mkept, all is well\u202e\u2028\x7f\u200b")
    assert visible("Überfahrt 3°, µ ± 1 m²") == "Überfahrt 3°, µ ± 1 m²"
    assert visible("a\nb\tc\x1b", keep="\n") == "a\nb\\tc\\x1b"


def test_texts_of_a_vehicle_are_quoted_and_limited_in_number_and_length():
    assert quoted(["PreArm: a", "PreArm: a", 'say "kept"\n']) == '"PreArm: a"; "say \'kept\'\\n"'
    many = quoted([f"text {k}" for k in range(500)])
    assert many == '"text 497"; "text 498"; "text 499" and 497 more before'
    assert len(quoted(["x" * 5000])) < 250
    assert quoted([]) == ""


def test_the_length_of_a_text_in_chunks_is_limited():
    log = TextLog()
    for k in range(255):
        log.take(mavlink.MAVLink_statustext_message(6, b"y" * 50, id=7, chunk_seq=k), 0.0)
    done = log.take(mavlink.MAVLink_statustext_message(6, b"end", id=7, chunk_seq=255), 0.0)
    assert done is not None
    assert len(done.text) <= 1050


@pytest.mark.parametrize("terminal", [True, False])
def test_live_messages_and_progress_are_escaped(terminal):
    stream = io.StringIO()
    with TerminalObserver(Console(file=stream, force_terminal=terminal, width=200, color_system=None)) as observer:
        observer.say(FORGED)
        observer.update(Progress(FORGED, FORGED, 1.0, signal=FORGED, guard=FORGED))
    shown = stream.getvalue().replace("\x1b[2K", "")  # the line is erased by us
    assert is_escaped(shown.replace("\r", ""))
    assert "\nkept, all is well" not in shown
    assert r"\x1b" in shown


@pytest.mark.parametrize(
    "thing",
    [
        Note(FORGED),
        Note(FORGED, kind="bullet"),
        Note(FORGED, kind="command"),
        Table((FORGED, "b"), "lr", ((FORGED, FORGED),)),
    ],
    ids=["text", "bullet", "command", "table"],
)
def test_the_final_report_is_escaped(thing):
    verdict = Verdict(FORGED, "good", (FORGED,))
    section = Section("one", FORGED, (thing,))
    shown = render_text(Document(FORGED, (section,), verdict, lead=FORGED, doubts=(Remark(FORGED),)), width=300)
    assert is_escaped(shown)
    assert not any(line.strip().startswith("kept") for line in shown.splitlines())
    assert r"\x1b" in shown


def test_a_progress_bar_shows_a_stage_without_markup():
    stream = io.StringIO()
    with StageBar(Console(file=stream, force_terminal=True, width=200, color_system=None)) as bar:
        bar("[red]" + FORGED, 1, 2)
    assert "[red]ok" in stream.getvalue()
    assert "\x1b]0" not in stream.getvalue()


@pytest.mark.slow
def test_the_page_shows_forged_text_as_text():
    story = kept()
    hostile = FORGED + "<script>alert(1)</script>"
    fit = replace(story.fit, used=(hostile,))
    page = page_of(
        replace(story, reason=hostile, fit=fit, vehicle={"name": hostile}, events=((1.0, hostile),), doubts=(hostile,))
    )
    assert is_escaped(page)
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page


def test_a_figure_shows_dollar_signs_backslashes_and_angle_brackets_as_text():
    name = r"$\frac{1}{2}$ \x1b \1 <b> & $"
    with pens("p"):
        figure, (axes,) = new_axes((1.0,))
        axes.set_title(name)
        drawn = to_svg(figure, "p", name)
    assert r"$\frac{1}{2}$ \x1b \1 &lt;b&gt; &amp; $" in drawn
    assert "<b>" not in drawn


def test_an_error_is_one_escaped_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["identify", f"no{FORGED}such.csv"]) == 6
    err = capsys.readouterr().err
    assert is_escaped(err)
    assert err.count("\n") == 1


def test_a_prompt_is_one_escaped_line(capsys, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Terminal("n\n"))
    assert not ConsoleOperator(yes=False).ask(f"write {FORGED}?", lambda: None)
    assert is_escaped(capsys.readouterr().err)


def test_column_names_of_a_file_are_escaped_in_every_output(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{0.1 * k:.1f},{0.01 * (k % 40)},{1 if k % 40 < 20 else -1},0\n" for k in range(200))
    (tmp_path / "run.csv").write_text(f't[s],psi[rad],N[N m],"\x1b[2Jq\x9bz"\n{rows}', newline="")
    main(["identify", "run.csv", "--structure", "linear", "--no-check", "--use", "\x1b[2Jpsi"])
    out, err = capsys.readouterr()
    assert is_escaped(out + err)
    assert main(["identify", "run.csv", "--structure", "linear", "--no-check", "--json"]) in (0, 6)
    out, err = capsys.readouterr()
    assert is_escaped(out + err)
    assert not out or json.loads(out)
