"""Where results go: never in silence over those of an earlier run."""

from __future__ import annotations

import itertools
from pathlib import Path

__all__ = ["fresh", "on_replacing"]


def fresh(path: Path) -> Path:
    """Return *path*, or, where something lies there already, the first of ``NAME-2``, ``NAME-3``, ... that is free.

    For the names that commands choose themselves; a name given by the user is written over, and that is said.
    """
    later = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    return next(p for p in itertools.chain([path], later) if not p.exists())


def on_replacing(path: Path) -> str:
    """Return what to add to the line that names *path*, asked before it is written: empty when nothing is lost."""
    is_there = any(path.iterdir()) if path.is_dir() else path.exists()
    return " (in place of what was there)" if is_there else ""
