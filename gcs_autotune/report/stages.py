"""How far a long calculation is: a bar on a terminal, nothing elsewhere."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from gcs_autotune.foreign_text import visible

__all__ = ["StageBar"]


class StageBar:
    """One line for the stage under way; gone when all is done. Silent where *console* is no terminal."""

    def __init__(self, console: Console) -> None:
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task: TaskID | None = None

    def __enter__(self) -> StageBar:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take note that *done* of *total* pieces of *stage* are behind us."""
        if self._task is None:
            self._task = self._bar.add_task(visible(stage), total=total)
        self._bar.update(self._task, description=visible(stage), completed=done, total=total)
