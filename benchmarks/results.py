"""Headline figures of the benchmarks: one JSON file each, and the table of ``benchmarks/README.md`` made from them.

A benchmark calls :func:`headline` at its end. That prints its figures. With ``BENCHMARKS_RECORD=1`` in the environment
it also writes ``benchmarks/results/NAME.json`` and updates the table::

    BENCHMARKS_RECORD=1 python3 -m benchmarks.first_harmonic     # measure and keep
    python3 -m benchmarks.results                                # update the table
    python3 -m benchmarks.results reach                          # print all figures of one benchmark
"""

from __future__ import annotations

import datetime
import math
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from gcs_autotune_files import conform, read

__all__ = ["FOLDER", "PAGE", "RECORD", "Figure", "Result", "commit", "count", "headline", "load", "page"]

FOLDER = Path(__file__).parent / "results"
PAGE = Path(__file__).parent / "README.md"
RECORD = "BENCHMARKS_RECORD"
BEGIN, END = "<!-- results: made by python3 -m benchmarks.results -->\n", "<!-- end of results -->\n"
HEAD = "| benchmark | measures | headline | goals met | date, commit |\n|---|---|---|---|---|\n"
BY_HAND = " †"
"""Marks a result that was copied from an earlier page instead of written by its benchmark."""


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One measured number.

    ``of``: the number of cases, if ``value`` counts successes; ``least`` and ``most`` are then fractions (0 to 1).
    Otherwise these bounds are in ``unit``. A figure without bounds has no goal. A value that is not finite is None, and
    misses its goal.
    """

    name: str
    value: float | None
    unit: str = ""
    of: int | None = None
    least: float | None = None
    most: float | None = None

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None without one."""
        if self.least is None and self.most is None:
            return None
        if self.value is None or self.of == 0:
            return False
        value = self.value / (self.of or 1)
        return (self.least is None or value >= self.least) and (self.most is None or value <= self.most)

    @property
    def shown(self) -> str:
        """The number to three digits with its unit, such as ``0.24 s``, or the count, such as ``19 of 20``."""
        if self.value is None:
            return "not finite"
        if self.of is not None:
            return f"{self.value:g} of {self.of}"
        return f"{float(f'{self.value:.3g}'):g} {self.unit}".rstrip()

    @property
    def goal(self) -> str:
        """The goal, such as ``at least 95 %``; empty without one."""
        if self.of is not None and self.least == 1.0:
            return "all"
        bounds = (("at least", self.least), ("at most", self.most))
        scale, unit = (1.0, self.unit) if self.of is None else (100.0, "%")
        return ", ".join(f"{word} {scale * bound:g} {unit}".rstrip() for word, bound in bounds if bound is not None)


def count(name: str, value: int, of: int, *, least: float | None = None, most: float | None = None) -> Figure:
    """Return *value* of *of* cases; ``least`` and ``most`` are fractions (0 to 1)."""
    return Figure(name, value, of=of, least=least, most=most)


class Result(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The last recorded run of a benchmark.

    The first of ``figures`` is the headline; none means that no run is recorded. ``date`` is ISO 8601. ``commit`` has a
    ``+`` if the tree had changes. ``origin`` is empty if the benchmark wrote the file itself.
    """

    benchmark: str
    measures: str
    command: str
    figures: tuple[Figure, ...] = ()
    date: str = ""
    commit: str = ""
    machine: str = ""
    origin: str = ""

    @property
    def row(self) -> str:
        """The line of the table."""
        goals = [f.met for f in self.figures if f.met is not None]
        first = f"{self.figures[0].name}: **{self.figures[0].shown}**" if self.figures else "not recorded"
        met = f"{sum(goals)} of {len(goals)}" if goals else ""
        when = ", ".join(filter(None, (self.date, self.commit and f"`{self.commit}`")))
        mark = BY_HAND if self.origin else ""
        link = f"[{self.benchmark}](results/{self.benchmark}.json)"
        return f"| {link} | {self.measures} | {first} | {met} | {when}{mark} |\n"


def headline(benchmark: str, measures: str, figures: Sequence[Figure]) -> None:
    """Print the headline *figures* of a run, and save them with ``BENCHMARKS_RECORD=1``.

    *measures* is a phrase for the table. The first figure is shown there, all are in the file.
    """
    figures = [f if f.value is None or math.isfinite(f.value) else replace(f, value=None) for f in figures]
    for figure in figures:
        print(_line(figure))
    if not os.environ.get(RECORD):
        return
    now = datetime.datetime.now(datetime.UTC).date().isoformat()
    result = Result(benchmark, measures, _command(), tuple(figures), now, STARTED_AT or commit(), _machine())
    print(f"kept in {save(result)}")
    PAGE.write_text(page(), encoding="utf-8")


def save(result: Result) -> Path:
    """Write *result* into :data:`FOLDER` and return its file."""
    path = FOLDER / f"{result.benchmark}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n")
    return path


def load() -> list[Result]:
    """Return every recorded result, by name."""
    return [conform(read(path), Result) for path in sorted(FOLDER.glob("*.json"))]


def page() -> str:
    """Return :data:`PAGE` with the table of the results there are."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    return before + BEGIN + HEAD + "".join(r.row for r in load()) + END + rest.partition(END)[2]


def _line(figure: Figure) -> str:
    goal = f" (goal: {figure.goal}{'' if figure.met else ', missed'})" if figure.goal else ""
    return f"{figure.name}: {figure.shown}{goal}"


def _command() -> str:
    """Return the command that runs now, from the repository root."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    module = spec.name.removesuffix(".__main__") if spec is not None else Path(sys.argv[0]).stem
    return shlex.join(["python3", "-m", module, *sys.argv[1:]])


CODE = (
    "gcs_autotune",
    "gcs_autotune_files",
    "sitl",
    "benchmarks",
    "tests/plants",
    ":!benchmarks/results",
    ":!*.md",
    ":!benchmarks/real_diagnosis/answers.json",
)
"""What a figure depends on."""


def commit() -> str:
    """Return the commit of the tree, with a ``+`` if tracked code differs from it; ``none`` outside a checkout."""
    root = Path(__file__).parents[1]

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", *CODE)
    return (git("rev-parse", "--short=8", "HEAD") or "none") + ("+" if changed else "")


STARTED_AT = commit() if os.environ.get(RECORD) else ""
"""The commit when the benchmark started: a long run may end on another one."""


def _machine() -> str:
    """Return processor, cores and Python."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text(encoding="utf-8").splitlines() if cpu.exists() else []
    model = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine()
    )
    return f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def main(names: Sequence[str]) -> int:
    """Print the figures of the benchmarks named, or update the table without a name."""
    if not names:
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    known = {r.benchmark: r for r in load()}
    for name in names:
        if name not in known:
            print(f"No results of {name}. There are: {', '.join(known)}.", file=sys.stderr)
            return 2
        result = known[name]
        print(f"{name}: {result.measures}\n{result.command}\n{result.date} {result.commit} {result.machine}")
        print("\n".join(map(_line, result.figures)) or "not recorded")
        print(result.origin)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
