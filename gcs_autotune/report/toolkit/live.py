"""The live lines: progress of a manoeuvre, and of a long calculation.

In a terminal one line is updated in place. Otherwise a plain line is printed every few seconds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType

from rich.console import Console, Group
from rich.control import Control
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress
from rich.segment import ControlType
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from gcs_autotune.clock import Clock, WallClock
from gcs_autotune.observer import Fact, Intentions, Progress, Words
from gcs_autotune.report.toolkit.tied import TiedText
from gcs_autotune.report.toolkit.wording import format_quantity, format_seconds, format_share, to_people, with_signs
from gcs_autotune.sname import SIGNALS
from gcs_autotune.untrusted_text import quoted, visible

__all__ = ["StageBar", "TerminalObserver", "describe_progress"]


_SIGNALS: Mapping[str, tuple[str, str]] = {
    "psi": ("heading", "rad"),
    "phi": ("roll", "rad"),
    "theta": ("pitch", "rad"),
    "z": ("depth", "m"),
    "d": ("distance", "m"),
    "x": ("distance ahead", "m"),
    "y": ("distance to starboard", "m"),
    "u": ("speed", "m/s"),
    "r": ("turn rate", "rad/s"),
}
"""Progress.signal -> (name, SI unit of its value)."""

REDRAW = 0.1
"""Shortest time [s] between two updates of the line; the eye follows about ten a second. Project choice."""

PLAIN_EVERY = 5.0
"""Vehicle time [s] between two plain lines, for a readable log. Project choice."""

BAR = 5
"""Width of the bar [characters], so that the signal still fits into 80 columns. Project choice."""

ONCE = ("link: ", "vehicle: ", "the autopilot's gyro filter ")
"""Beginnings of sentences that every step of a job repeats. They are shown again only if they have changed."""

BUSY = ("identifying", "designing", "computing ", "writing the report")
"""Beginnings of sentences on calculations without progress of their own. A spinner turns beside them until the next
output.
"""

STALE = 1.0
"""Age of the last message [s] above which the line begins with the silence of the link: ten control periods. Project
choice.
"""


def describe_progress(progress: Progress, width: int = 0) -> str:
    """Return *progress* as one line of text. With a *width* [characters], the least important items are left out.

    ``t`` is shown if the time since the start is unknown. Order of importance: stage, elapsed and remaining time,
    a silent link and the step, the signal and its target, periods, the nearest limit, amplitude, output, scatter.
    """
    pieces = _pieces(progress)
    while width and len(pieces) > 1 and len(_join(pieces)) > width:
        pieces.remove(max(pieces, key=lambda piece: piece[0]))
    line = _join(pieces)
    return line if not width or len(line) <= width else line[: max(0, width - 1)] + "~"


def _join(pieces: list[tuple[int, str]]) -> str:
    return "  ".join(text for _, text in pieces)


def _pieces(p: Progress) -> list[tuple[int, str]]:
    """Return pairs (rank, text) in the order of the line. Parts of lower rank are kept longer."""
    since = p.elapsed if math.isfinite(p.elapsed) else p.t
    pieces = [(0, f"{p.manoeuvre or p.stage} {format_seconds(since)}{_left(p)}")]
    if p.steps:
        pieces.insert(0, (1, f"step {p.step} of {p.steps} {_bar(p)}".rstrip()))
    if p.signal:
        pieces.append((2, _signal(p)))
    if math.isfinite(p.output):
        pieces.append((6, f"output {format_share(p.output)}"))
    if math.isfinite(p.amplitude):
        pieces.append((5, f"amplitude {format_quantity(p.amplitude, SIGNALS[p.signal].unit)}"))
    if p.periods_needed:
        pieces.append((3, f"periods {p.periods}/{p.periods_needed}"))
    if math.isfinite(p.scatter):
        pieces.append((7, f"scatter {format_share(p.scatter)}"))
    if p.guard:
        pieces.append((4, f"{p.guard} limit {format_share(p.guard_share)} used"))
    if p.age > STALE:
        pieces.insert(1, (1, f"NO MESSAGES FOR {format_seconds(p.age)}"))
    return pieces


def _bar(p: Progress) -> str:
    """Return a bar that shows the completed fraction."""
    whole = p.elapsed + p.left
    if not (math.isfinite(whole) and whole > 0.0):
        return ""
    done = min(int(BAR * p.elapsed / whole), BAR)
    return "#" * done + "." * (BAR - done)


def _left(p: Progress) -> str:
    if not math.isfinite(p.left):
        return ""
    return f", {math.ceil(p.left / 60.0)} min left" if p.left > 60.0 else ", <1 min left"


def _signal(p: Progress) -> str:
    row = SIGNALS.get(p.signal)
    name, unit = _SIGNALS.get(p.signal) or ((p.signal, "") if row is None else (row.meaning, row.unit))
    text = f"{name} {_reading(p.value, p.signal, unit)}"
    return text + (f" (target {_reading(p.target, p.signal, unit)})" if math.isfinite(p.target) else "")


def _reading(value: float, signal: str, unit: str) -> str:
    if not math.isfinite(value):
        return "?"
    row = SIGNALS.get(signal)
    if row is not None and row.wraps:
        return f"{round(math.degrees(value), 1) % 360.0:05.1f}°"
    if row is not None and row.angular:
        return f"{math.degrees(value):.1f}{to_people(row.unit)[0]}"
    return f"{value:.2f} {unit}".rstrip()


class TerminalObserver:
    """Shows progress on a ``rich`` console. Call :meth:`close` (or use ``with``) before anything else writes.

    quiet : show sentences only, without progress. verbose : print plain lines in a terminal too, and the vehicle's
        messages.
    """

    def __init__(
        self, console: Console, clock: Clock | None = None, *, quiet: bool = False, verbose: bool = False
    ) -> None:
        self._console = console
        self._quiet = quiet
        self._verbose = verbose
        self._kept = verbose or not console.is_terminal
        self._clock = clock or WallClock()
        self._drawn = -math.inf
        self._printed_at = -math.inf
        self._leg = ("", "")
        self._line_open = False
        self._busy: tuple[Text, Live] | None = None
        self._began = math.nan
        self._shown: set[str] = set()
        self._announced: set[str] = set()

    def __enter__(self) -> TerminalObserver:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def update(self, progress: Progress) -> None:
        """Show the progress at a control tick, if an update of the line is due."""
        if self._quiet:
            return
        if not progress.t >= self._began:
            self._began = progress.t
        if not math.isfinite(progress.elapsed):
            progress = replace(progress, elapsed=progress.t - self._began)
        if self._kept:
            self._print_progress(progress)
        if self._console.is_terminal:
            self._redraw(progress)

    def say(self, text: str) -> None:
        """Show a sentence on a separate line."""
        if text in self._shown:
            return
        if text.startswith(ONCE) and not self._verbose:
            self._shown.add(text)
        self._erase()
        if text.startswith(BUSY) and self._console.is_terminal:
            self._spin(Text(self._typeset(text)))
            return
        text, introduces, command = self._typeset(text).partition(": gcs-autotune ")
        if not introduces:
            self._console.print(Group(TiedText(text)))
            return
        self._console.print(Group(TiedText(f"{text}:")))  # a command is copied: it stays one line, whatever its length
        self._console.print(Text(f"  gcs-autotune {command}"), soft_wrap=True)

    def _typeset(self, text: str) -> str:
        """Return *text* as it is shown, with degree signs if the terminal has them."""
        shown = visible(text)
        try:
            "°".encode(self._console.encoding)
        except UnicodeEncodeError:
            return shown
        return with_signs(shown)

    def note(self, fact: Fact) -> None:
        """Show the announcement, and a text message of the vehicle if verbose. Other notes are not shown."""
        if isinstance(fact, Intentions):
            self._announce(fact)
        elif self._verbose and isinstance(fact, Words):
            self.say(f"vehicle message: {quoted([fact.text])}")

    def _announce(self, intentions: Intentions) -> None:
        """Show a table, one row per intention with its brief. The sentences of these rows are then not repeated,
        and those of usual intentions are left out.

        An intention that was announced before, for the whole job, is not shown again.
        """
        if self._verbose:
            return
        self._erase()
        known = [each for each in intentions.each if (each.brief or each.text) in self._announced]
        rows = [each for each in intentions.each if each.row and each not in known]
        table = Table.grid(padding=(0, 2))
        table.add_column(style="bold", no_wrap=True)
        for each in rows:
            table.add_row(Text(each.row), Text(self._typeset(each.brief)))
        self._console.print(table)
        usual = (each for each in intentions.each if each.is_usual)
        self._shown |= {f"will {each.text}" for each in (*known, *rows, *usual)}
        self._announced |= {each.brief or each.text for each in intentions.each}

    def close(self) -> None:
        """End the live line, so that other output starts on a new line. It may be called without a live line."""
        self._stop_spinning()
        if self._line_open:
            self._console.print()
            self._line_open = False

    def _spin(self, text: Text) -> None:
        """Show *text* with a spinner."""
        spinner = Spinner("dots", text)
        live = Live(spinner, console=self._console, transient=True, redirect_stdout=False, redirect_stderr=False)
        live.start()
        self._busy = (text, live)

    def _stop_spinning(self) -> None:
        """Replace the spinner and its text by the text alone."""
        if self._busy is not None:
            text, live = self._busy
            self._busy = None
            live.stop()
            self._console.print(text)

    def _redraw(self, progress: Progress) -> None:
        now = self._clock.now()
        if now - self._drawn < REDRAW:
            return
        self._drawn = now
        self._erase()
        line = describe_progress(progress, self._console.width - 1)
        self._console.print(Text(visible(line)), end="", no_wrap=True, crop=True)
        self._line_open = True

    def _erase(self) -> None:
        self._stop_spinning()
        if self._line_open:
            self._console.control(Control((ControlType.CARRIAGE_RETURN,), (ControlType.ERASE_IN_LINE, 2)))
            self._line_open = False

    def _print_progress(self, progress: Progress) -> None:
        leg = (progress.stage, progress.manoeuvre)
        since = progress.t - self._printed_at
        if leg == self._leg and 0.0 <= since < PLAIN_EVERY:
            return
        self._leg, self._printed_at = leg, progress.t
        self._erase()
        self._console.print(Text(visible(describe_progress(progress))), soft_wrap=True)


class _TimeLeft(ProgressColumn):
    """The column of a progress bar with the time left until the time limit."""

    def __init__(self, given: float) -> None:
        super().__init__()
        self._given = given

    def render(self, task: Task) -> Text:
        """Return the text of the column: minutes and seconds."""
        left = max(0, round(self._given - (task.elapsed or 0.0)))
        return Text(f"at most {left // 60}:{left % 60:02d} left")


class StageBar:
    """One line for the current stage, removed at the end. Silent if *console* is not a terminal.

    verbose : keep a line for each completed stage, also without a terminal. given : time limit [s], shown if it is long
        enough.
    """

    def __init__(self, console: Console, *, verbose: bool = False, given: float = math.inf) -> None:
        self._kept, self._stage = console if verbose else None, ""
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            *(() if math.isinf(given) else (_TimeLeft(given),)),
        )
        self._bar = RichProgress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task: TaskID | None = None

    def __enter__(self) -> StageBar:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Record that *done* of *total* parts of *stage* are complete."""
        if self._kept is not None and stage != self._stage:
            self._stage = stage
            self._kept.print(Text(visible(stage)))
        if self._task is None:
            self._task = self._bar.add_task(visible(stage), total=total)
        self._bar.update(self._task, description=visible(stage), completed=done, total=total)
