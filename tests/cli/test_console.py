"""The operator at the terminal: prompts, the bell, and an orderly stop."""

from __future__ import annotations

import argparse
import io
import os
import signal
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_autotune.cli import console
from gcs_autotune.cli.command import waiting
from gcs_autotune.cli.console import BELL_VARIABLE, ConsoleOperator
from gcs_autotune.errors import UsageError
from gcs_autotune.observer import stopping


class Terminal(io.StringIO):
    """A stream that is a terminal, or only looks like one of files."""

    def __init__(self, text: str = "", *, tty: bool = True) -> None:
        super().__init__(text)
        self._tty = tty

    def isatty(self) -> bool:
        return self._tty


@pytest.fixture
def streams(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """What the console takes for ``sys``: two terminals."""
    monkeypatch.delenv(BELL_VARIABLE, raising=False)
    streams = SimpleNamespace(stdin=Terminal(), stderr=Terminal())
    monkeypatch.setattr(console, "sys", streams)
    return streams


@pytest.mark.parametrize(
    ("answer", "agrees"), [("y\n", True), ("Yes \n", True), ("n\n", False), ("\n", False), ("", False)]
)
def test_a_prompt_rings_the_bell_and_only_yes_confirms(streams: SimpleNamespace, answer: str, agrees: bool) -> None:
    streams.stdin = Terminal(answer)
    assert ConsoleOperator(yes=False).ask("Go ahead?", lambda: None) is agrees
    assert streams.stderr.getvalue() == "Go ahead? [y/N] \a"


def test_the_bell_rings_at_the_end_unless_switched_off(
    streams: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    ConsoleOperator(yes=True).ring()
    assert streams.stderr.getvalue() == "\a"
    ConsoleOperator(yes=True, bell=False).ring()
    for word in ("off", "OFF", "0", "no"):
        monkeypatch.setenv(BELL_VARIABLE, word)
        ConsoleOperator(yes=True).ring()
    assert streams.stderr.getvalue() == "\a"
    monkeypatch.setenv(BELL_VARIABLE, "on")
    ConsoleOperator(yes=True).ring()
    assert streams.stderr.getvalue() == "\a\a"


def test_output_to_a_file_contains_no_bell(streams: SimpleNamespace) -> None:
    log = streams.stderr = Terminal(tty=False)
    ConsoleOperator(yes=True).ring()
    streams.stdin = Terminal("y\n")
    assert ConsoleOperator(yes=False).ask("Go ahead?", lambda: None)
    assert "\a" not in log.getvalue()
    streams.stderr = None
    ConsoleOperator(yes=True).ring()


def test_yes_skips_the_prompt_and_without_a_terminal_the_options_are_named(
    streams: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    streams.stdin = Terminal("n\n", tty=False)
    assert ConsoleOperator(yes=True).ask("Go ahead?", lambda: None)
    assert streams.stderr.getvalue() == ""
    with pytest.raises(UsageError, match="Add --yes to answer yes in advance, or --dry-run"):
        ConsoleOperator(yes=False, otherwise="or --dry-run").ask("Go ahead?", lambda: None)


def test_text_from_a_vehicle_cannot_forge_a_prompt(streams: SimpleNamespace) -> None:
    streams.stdin = Terminal("y\n")
    ConsoleOperator(yes=False, bell=False).ask("Write \x1b[2JX?", lambda: None)
    assert "\x1b" not in streams.stderr.getvalue()


def test_a_long_prompt_and_the_reply_to_a_stop_are_folded_between_words(
    streams: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    streams.stdin = Terminal("y\n")
    question = " ".join(["Write ATC_STR_RAT_P 0.2 -> 2?"] * 7)
    operator = ConsoleOperator(yes=False, bell=False)
    operator.ask(question, lambda: None)
    asked = streams.stderr.getvalue()
    assert asked.endswith("[y/N] ") and asked.split() == f"{question} [y/N]".split()
    operator._note(signal.SIGINT, None)
    told = streams.stderr.getvalue().removeprefix(asked)
    assert told.startswith("\n") and told.split() == stopping(again=False).split()
    assert max(map(len, [*asked.splitlines(), *told.splitlines()])) <= 80


def test_the_first_signal_requests_a_stop_and_later_ones_only_a_message(streams: SimpleNamespace) -> None:
    before = signal.getsignal(signal.SIGTERM)
    operator = ConsoleOperator(yes=True)
    with operator.listening():
        assert not operator.stop_requested()
        os.kill(os.getpid(), signal.SIGTERM)
        assert operator.stop_requested()
        assert stopping(again=False) in " ".join(streams.stderr.getvalue().split())
        os.kill(os.getpid(), signal.SIGINT)
        assert streams.stderr.getvalue().endswith("Still restoring the vehicle. Please wait.\n")
    assert signal.getsignal(signal.SIGTERM) is before


class Interrupted(io.RawIOBase):
    """What is written to it is interrupted by a signal each time, as a terminal may be."""

    def __init__(self, number: int, signalled: Callable[[], None]) -> None:
        super().__init__()
        self._number, self._signalled = number, signalled

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def write(self, piece: Any) -> int:
        self._signalled()
        return os.write(self._number, piece)


def test_a_signal_during_output_is_handled_and_does_not_raise(
    streams: SimpleNamespace,
) -> None:
    """A tune ended in "reentrant call inside BufferedWriter" where Ctrl-C met a line that was being written."""
    out, into = os.pipe()
    operator = ConsoleOperator(yes=True)
    buffered = io.BufferedWriter(Interrupted(into, lambda: operator._note(signal.SIGINT, None)))
    streams.stderr = io.TextIOWrapper(buffered, write_through=True)
    streams.stderr.write("first self-oscillation\n")
    streams.stderr.flush()
    assert operator.stop_requested()
    assert os.read(out, 1000).decode() == f"\n{stopping(again=False)}\nfirst self-oscillation\n"
    os.close(out)
    operator._note(signal.SIGHUP, None)  # the reader is gone
    streams.stderr = None
    operator._note(signal.SIGTERM, None)
    os.close(into)


def test_silent_work_shows_a_spinner_on_a_terminal_but_not_with_json(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes any stream for a terminal
    for asked, shown in (({}, True), ({"json": True}, False), ({"quiet": True}, False)):
        with waiting(argparse.Namespace(**asked), "reading the runs"):
            pass
        assert ("reading the runs" in capsys.readouterr().err) is shown
