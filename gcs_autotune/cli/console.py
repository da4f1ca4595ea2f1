"""The operator at the terminal: Ctrl-C as a stop request, questions that keep the link alive, the live line."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from gcs_autotune.cli.writing import folded
from gcs_autotune.errors import UsageError
from gcs_autotune.observer import stopping
from gcs_autotune.untrusted_text import visible

__all__ = ["BELL_VARIABLE", "ConsoleOperator"]

BELL_VARIABLE = "GCS_AUTOTUNE_BELL"
_STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class ConsoleOperator:
    """Turns signals into a request to stop and asks questions on the terminal.

    The first Ctrl-C (or SIGTERM, or the terminal closing) requests an orderly stop: neutral actuators, mode and
    parameters restored. Further ones only report that the clean-up is in progress. It is never interrupted.

    yes : the answer to every question. otherwise : alternative to ``--yes`` that the error suggests. bell : ring
    the terminal's bell for questions and at the end.
    """

    def __init__(self, *, yes: bool, otherwise: str = "", bell: bool = True) -> None:
        self._yes = yes
        self._otherwise = f", {otherwise}" if otherwise else ""
        self._bell = bell and os.environ.get(BELL_VARIABLE, "").lower() not in ("off", "0", "no")
        self._stop = False

    @property
    def answered_beforehand(self) -> bool:
        """Whether ``--yes`` answers the questions."""
        return self._yes

    def ring(self) -> None:
        """Ring the terminal's bell for attention. Silent if standard error is not a terminal."""
        if self._bell and sys.stderr and sys.stderr.isatty():
            sys.stderr.write("\a")
            sys.stderr.flush()

    def stop_requested(self) -> bool:
        """Return whether a stop signal was received."""
        return self._stop

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Catch the stop signals inside this context and restore the previous handlers on exit.

        Ring the bell after an error.
        """
        numbers = [getattr(signal, name) for name in _STOP_SIGNALS if hasattr(signal, name)]
        previous = {number: signal.signal(number, self._note) for number in numbers}
        try:
            yield
        except BaseException:
            self.ring()
            raise
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def ask(self, question: str, while_waiting: Callable[[], object]) -> bool:
        """Return the answer to a yes/no question on the terminal. Only "y" or "yes" counts as yes.

        Raises
        ------
        UsageError
            Standard input is not a terminal and ``--yes`` is not set.
        """
        if self._yes:
            return True
        if not sys.stdin or not sys.stdin.isatty():
            raise UsageError(
                f"cannot ask '{question}': standard input is not a terminal. Add --yes to answer yes in advance"
                f"{self._otherwise}"
            )
        answers: list[str] = []
        reader = threading.Thread(target=lambda: answers.append(sys.stdin.readline()), daemon=True)
        sys.stderr.write(f"{folded(f'{visible(question)} [y/N]', sys.stderr).rstrip()} ")
        sys.stderr.flush()
        self.ring()
        reader.start()
        while reader.is_alive():
            while_waiting()
        return bool(answers) and answers[0].strip().lower() in ("y", "yes")

    def _note(self, number: int, frame: FrameType | None) -> None:
        again = self._stop
        self._stop = True
        _tell(stopping(again=again), before="" if again else "\n")


def _tell(text: str, before: str) -> None:
    """Write *before* and the folded *text* to standard error from a signal handler, which must never raise into the
    flight loop.

    Another write may be in progress in the same thread, and its buffer rejects a second one, so the buffer is bypassed.
    A closing terminal first sends its signal and then accepts no output.
    """
    try:
        number = sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):  # there is none, or none that the system knows
        number = None
    with suppress(AttributeError, OSError, ValueError, RuntimeError):
        lines = before + folded(text, sys.stderr)
        if number is None:
            sys.stderr.write(lines)
        else:
            os.write(number, lines.encode())
