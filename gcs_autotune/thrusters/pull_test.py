"""Read and write pull tests: command and force, as measured with a dynamometer (Miskovic2010, 4.1)."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.csv_table import cells_of, numbers_of
from gcs_autotune.errors import BadFile, MissingChannel, NotInformative
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import parse_header, to_si
from gcs_autotune.thrusters.propeller import OpenWaterTest
from gcs_autotune.trial import Trial

__all__ = [
    "COMMANDS",
    "FORCES",
    "PullTest",
    "pulls_from_log",
    "read_columns",
    "read_open_water",
    "read_pull_test",
    "resolution",
    "write_pulls",
]

Array = NDArray[np.float64]

COMMANDS = ("n", "command", "pwm", "voltage", "throttle")
"""Names of columns that may contain the command, in order of preference."""

FORCES = ("T", "force", "thrust", "X", "Z")
"""Names of columns that may contain the force, in order of preference."""

MIN_PULLS = 5
"""Minimum number of pulls for a map. Project choice."""

SLACK, GRID = 0.2, 0.1
"""Settings for matching a load cell's log to a bollard run. Project choice.

- ``SLACK``: largest fraction of the run that the log may lack.
- ``GRID``: step of the search for the clock offset [s].
"""

_RAW = {"us": "us", "pwm": "us"}
"""Command units that are not converted; a pulse width denotes a stick position, not a duration."""


@dataclass(frozen=True, slots=True, eq=False)
class PullTest(Displayed):
    """Pulls of one thruster: ``command`` (n,) in ``unit``, and ``force`` (n,) [N], positive along the thruster."""

    name: str
    command: Array
    force: Array
    unit: str

    def __post_init__(self) -> None:
        if self.command.shape != self.force.shape or self.command.ndim != 1:
            raise NotInformative(f"pull test '{self.name}' needs one force per command")
        if not (np.all(np.isfinite(self.command)) and np.all(np.isfinite(self.force))):
            raise NotInformative(f"pull test '{self.name}' has values that are not numbers. Remove these rows")
        different = len(np.unique(self.command))
        if different < MIN_PULLS:
            raise NotInformative(
                f"pull test '{self.name}' has only {different} different commands. Measure at {MIN_PULLS} or more, "
                "including small ones"
            )
        if np.ptp(self.force) == 0.0:
            raise NotInformative(f"pull test '{self.name}': the force never changes. Check the dynamometer")

    def __len__(self) -> int:
        return len(self.command)


def read_columns(path: Path) -> dict[str, tuple[str, Array]]:
    """Return name -> (unit, values) of a CSV table with ``name[unit]`` headers, in SI except pulse widths.

    Raises
    ------
    BadFile
        The file is not readable, has no rows, or contains a cell that is not a number or an unknown unit.
    """
    cells = cells_of(path, "command[1],force[N]")
    try:
        heads = [parse_header(head) for head in cells.head]
        units = [(_RAW[unit], 1.0) if unit in _RAW else to_si(unit) for _, unit in heads]
    except BadFile as error:
        raise BadFile(f"{path}: {error}") from None
    table = numbers_of(cells)
    if table.dropped:
        raise BadFile(
            f"{path}, row {cells.first + len(cells.rows) - 1}: the row is incomplete, or a cell is not a number. "
            "Correct or remove it"
        )
    return {heads[i][0]: (units[i][0], table.values[:, k] * units[i][1]) for k, i in enumerate(table.columns)}


def read_pull_test(
    path: Path, *, command: str | None = None, force: str | None = None, pulls: Sequence[float] | None = None
) -> PullTest:
    """Return the pull test in a CSV file with one row per pull, or in a recording with a ``t`` column.

    Consecutive rows of a recording with one command are one pull (their mean force), because samples within a pull are
    not independent. Rows without either value are omitted.

    Parameters
    ----------
    command, force : names of the columns. None takes the first of :data:`COMMANDS` and of :data:`FORCES` in the file.
    pulls : forces [N] of the rows, which replace those in the file.

    Raises
    ------
    BadFile, MissingChannel, NotInformative
        The file is not a table, lacks the columns, or has too few pulls.
    """
    columns = read_columns(path)
    n_name, n_unit, n = _column(path, columns, command, COMMANDS, "command")
    if pulls is None:
        _, f_unit, f = _column(path, columns, force, FORCES, "force")
    else:
        f_unit, f = "N", np.asarray(pulls, dtype=np.float64)
        if len(f) != len(n):
            raise NotInformative(
                f"{path} has {len(n)} rows, but {len(f)} forces were supplied. Supply one force per row"
            )
    if f_unit not in ("N", "1"):
        raise BadFile(f"{path}: a force in [{f_unit}] cannot be used. Convert it to N, kN or kgf")
    keep = np.isfinite(n) & np.isfinite(f)
    n, f = n[keep], f[keep]
    if "t" in columns and len(n):
        starts = np.flatnonzero(np.concatenate([[True], np.diff(n) != 0.0]))
        counts = np.diff(np.append(starts, len(n)))
        n, f = n[starts], np.add.reduceat(f, starts) / counts
    return PullTest(f"{path.stem}/{n_name}", n, f, n_unit)


def pulls_from_log(table: Path, log: Path, *, force: str | None = None) -> tuple[list[float], float]:
    """Return the pull [N] of each level of a flown *table* (:func:`write_pulls`), measured in a load cell's *log*, and
    the clock offset. The clock offset [s] is that of the log from the vehicle. With this offset, command and squared
    command explain most of the measured force. It is accurate to a tenth of a second. The pull of a level is the mean
    force from its middle to shortly before its end. It is NaN if the log does not cover the level.

    Raises
    ------
    BadFile, MissingChannel, NotInformative
        The files are not such tables, the log is shorter than four fifths of the run, or its force never changes.
    """
    levels, cell = read_columns(table), read_columns(log)
    for path, columns, wanted in ((table, levels, ("from", "to")), (log, cell, ("t",))):
        if not set(wanted) <= columns.keys():
            heads = " and ".join(f"{n}[s]" for n in wanted)
            raise MissingChannel(f"{path} has no time column. It needs {heads}. Its columns are {', '.join(columns)}")
    starts, ends, t = levels["from"][1], levels["to"][1], cell["t"][1]
    _, _, F = _column(log, cell, force, FORCES, "force")
    good = np.isfinite(t) & np.isfinite(F)
    t, F = t[good], F[good]
    slack = SLACK * float(ends[-1] - starts[0])
    if len(t) < MIN_PULLS or t[-1] - t[0] < ends[-1] - starts[0] - slack or np.ptp(F) == 0.0:
        raise NotInformative(
            f"{log} does not match {table}. The load cell's log must cover the {ends[-1] - starts[0]:.0f} s of "
            "command levels, with a changing force"
        )
    _, _, command = _column(table, levels, None, COMMANDS, "command")
    shapes = np.column_stack([np.ones_like(command), command, command * np.abs(command)])

    def unexplained(offset: float) -> float:
        """Return the fraction of the force's variance that the commands do not explain, for one clock offset."""
        level = np.searchsorted(starts + offset, t, side="right") - 1
        used = (level >= 0) & (t <= ends[-1] + offset)
        if t[used].size < MIN_PULLS or np.ptp(t[used]) < ends[-1] - starts[0] - slack or np.ptp(F[used]) == 0.0:
            return math.inf
        regressors = shapes[level[used]]
        residual = F[used] - regressors @ np.linalg.lstsq(regressors, F[used], rcond=None)[0]
        return float(np.var(residual) / np.var(F[used]))

    offsets = np.arange(t[0] - starts[0] - slack, t[-1] - ends[-1] + slack + GRID, GRID)
    best = float(min(offsets, key=unexplained))
    pulls = []
    for begin, end in zip(0.5 * (starts + ends) + best, 0.1 * starts + 0.9 * ends + best, strict=True):
        held = F[np.searchsorted(t, begin) : np.searchsorted(t, end)]
        pulls.append(float(held.mean()) if len(held) else math.nan)
    return pulls, best


def write_pulls(run: Trial, force: str, path: Path) -> None:
    """Write the command levels of a bollard run to *path* as a table of pulls. The user adds the measured forces.

    ``command``: the actuator output, as the mean over the second half of the level. ``from`` and ``to`` [s]: begin and
    end of the level on the vehicle's clock.

    Raises
    ------
    MissingChannel
        The run has no such force.
    """
    output = run[force]
    starts = [m.t for m in run.marks if m.kind == "level"]
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(["command[1]", "force[N]", "from[s]", "to[s]"])
        for start, end in zip(starts, [*starts[1:], run.end], strict=True):
            held = output.between(0.5 * (start + end), end).values
            level = float(held.mean()) if len(held) else output.held_at(end)
            table.writerow([f"{level:.4f}", "", f"{start:.2f}", f"{end:.2f}"])


def read_open_water(path: Path) -> OpenWaterTest:
    """Return the open-water test in a CSV file with ``n``, ``V_A``, ``T`` or another of :data:`FORCES`, and ``Q`` if
    measured.

    Raises
    ------
    BadFile, MissingChannel
        The file is not a table, or lacks the columns.
    """
    columns = read_columns(path)
    _, unit, n = _column(path, columns, "n", COMMANDS, "command")
    _, _, V_A = _column(path, columns, "V_A", (), "advance speed")
    _, _, T = _column(path, columns, None, FORCES, "force")
    if unit != "rad/s":
        raise BadFile(f"{path}: n in [{unit}] cannot be used. Convert it to rpm, rev/s or rad/s")
    Q = columns["Q"][1] if "Q" in columns else None
    keep = np.isfinite(n) & np.isfinite(V_A) & np.isfinite(T)
    keep = keep if Q is None else keep & np.isfinite(Q)
    return OpenWaterTest(n[keep], V_A[keep], T[keep], None if Q is None else Q[keep])


def resolution(values: Array) -> float:
    """Return the resolution of *values*: their last decimal place (0.01 for 1.25 and 3.40), or 0 if there is none."""
    largest = float(np.max(np.abs(values)))
    for digits in range(-2, 7):
        step = 10.0**-digits
        if largest >= 20.0 * step and np.all(np.abs(values / step - np.round(values / step)) < 1e-6):
            return step
    return 0.0


def _column(
    path: Path, columns: dict[str, tuple[str, Array]], wanted: str | None, known: Sequence[str], what: str
) -> tuple[str, str, Array]:
    name = wanted if wanted is not None else next((k for k in known if k in columns), None)
    if name is None or name not in columns:
        required = f"'{wanted}'" if wanted is not None else " or ".join(known)
        raise MissingChannel(
            f"{path} has no {what} column {required}. Its columns are {', '.join(columns)}. Select one with --{what}"
        )
    return (name, *columns[name])
