"""Files to mutate, by area, and changes that are not faults."""

from __future__ import annotations

from pathlib import Path

__all__ = ["AREAS", "NO_FAULT", "files_by_area"]

AREAS: dict[str, tuple[str, ...]] = {
    "kernels": ("**/*.py",),
    "safety": ("manoeuvres/*.py", "workflow/restore.py", "workflow/tunable_loop.py", "workflow/autopilot_loop.py"),
    "journal": ("**/journal.py", "**/parameter_transaction.py", "**/params_file.py", "mavlink/tlog.py"),
    "stamps": (
        "**/stamp_correction.py",
        "**/latency.py",
        "**/watchdog.py",
        "logs/dataflash.py",
        "logs/sample_store.py",
    ),
    "link": ("link/liveness.py", "link/parameters/*.py", "link/vehicle/*.py", "**/transport.py", "**/signing.py"),
    "results": (
        "**/chi_square.py",
        "**/frames.py",
        "**/sname.py",
        "**/trial.py",
        "design/margins.py",
        "design/open_loop.py",
        "design/selection.py",
        "design/step_metrics.py",
        "design/verdict.py",
        "diagnose/heldout.py",
        "diagnose/score.py",
        "identify/problems/likelihood.py",
        "identify/problems/problem.py",
        "identify/problems/noise.py",
        "**/cleaning.py",
        "identify/signals/whiteness.py",
        "**/least_squares.py",
        "identify/signals/intake.py",
        "logs/channels.py",
    ),
}
"""Area -> patterns of the files in ``gcs_autotune`` that faults are put into; a file is in the first area that has it.
The patterns are packages, or names in any package, so that a file may move. A pattern without a file is an error."""

ONLY_WITH: dict[str, str] = {"kernels": "import njit"}
"""Area -> text that a file must contain: kernels are in all files with compiled functions."""

WITHOUT: tuple[str, ...] = (
    "**/__init__.py",  # exports
    "manoeuvres/*_messages.py",  # texts, checked by golden files
    "manoeuvres/table.py",  # data
    "link/vehicle/commands.py",  # messages, tested with a whole vehicle
    "link/vehicle/mavlink_craft.py",
    "link/vehicle/rates.py",
    "link/vehicle/bandwidth.py",
    "link/vehicle/congestion.py",
    "link/vehicle/other_stations.py",
)
"""Patterns of files that are left out of every area."""


def files_by_area(root: Path) -> dict[str, list[str]]:
    """Return area -> its files, relative to *root*.

    Raises
    ------
    LookupError
        A pattern matches no file.
    """
    package = root / "gcs_autotune"
    taken = {file for pattern in WITHOUT for file in _matching(package, pattern)}
    found = {}
    for area, patterns in AREAS.items():
        matching = {f for pattern in patterns for f in _matching(package, pattern)} - taken
        files = sorted(f for f in matching if ONLY_WITH.get(area, "") in f.read_text(encoding="utf-8"))
        if not files:
            raise LookupError(f"the area {area} of the mutations has no file")
        taken.update(files)
        found[area] = [str(f.relative_to(root)) for f in files]
    return found


def _matching(package: Path, pattern: str) -> list[Path]:
    files = list(package.glob(pattern))
    if not files:
        raise LookupError(f"{package.name} has no file {pattern}: update {__file__}")
    return files


NO_FAULT: dict[str, str] = {
    "gcs_autotune/models/coupled/linear_kernel.py::linear_sweep: if 0 <= column < q: -> if 0 <= column <= q:": (
        "a column is below their number, or -1"
    ),
    "gcs_autotune/link/vehicle/watchdog.py::Watchdog.check_boot_time: self.stamps += 1 -> self.stamps += 2": (
        "the craft only checks whether the count has grown"
    ),
}
"""Fault (``Mutant.key``) -> reason why it is not a fault: it changes no documented behaviour. Judged by hand."""
