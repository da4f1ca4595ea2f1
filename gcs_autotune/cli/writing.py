"""Where results go; replacing those of an earlier run is always reported."""

from __future__ import annotations

import itertools
from pathlib import Path

__all__ = ["fresh", "on_replacing"]


def fresh(path: Path) -> Path:
    """Return *path*, or if it exists, the first free one of ``NAME-2``, ``NAME-3``, ...

    For names that a command chooses. A name that the user supplied is overwritten, and the command reports it.
    """
    later = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    return next(p for p in itertools.chain([path], later) if not p.exists())


def on_replacing(path: Path) -> str:
    """Return a note for the line that shows *path*; empty if no file is replaced. Call before writing."""
    is_there = any(path.iterdir()) if path.is_dir() else path.exists()
    return " (replaced an earlier file)" if is_there else ""
