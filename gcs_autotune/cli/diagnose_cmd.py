"""``gcs-autotune diagnose``: report what a simulation gets wrong, and the cause."""

from __future__ import annotations

import argparse
import math
import os
import shlex
from datetime import datetime
from pathlib import Path

from gcs_autotune.cli.command import Command, add_loudness, add_number, check_files, progress_bar, waiting
from gcs_autotune.cli.reading import add_reading, add_runs, read_others, read_runs
from gcs_autotune.cli.writing import fresh, on_replacing, put_out
from gcs_autotune.clock import WallClock
from gcs_autotune.errors import UsageError

__all__ = ["COMMAND"]


OF_A_TABLE = ("--json", "--quiet")
"""Options that apply to a table of parameters."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_runs(parser)
    parser.add_argument("--list-effects", action="store_true", help="list the effects and their parameters, then exit")
    base = parser.add_argument_group(
        "simulation to examine (default: a plain model, uncoupled with linear damping, fitted to the runs)"
    )
    base.add_argument(
        "--model", type=Path, metavar="FILE", help="model file written by identify, tune or diagnose (JSON)"
    )
    base.add_argument(
        "--simulation",
        action="extend",
        nargs="+",
        default=[],
        type=Path,
        metavar="RUN",
        help="output of another simulator for the same commands, one file per run in the same order",
    )
    what = parser.add_argument_group("model and signals to examine")
    what.add_argument(
        "--dof",
        metavar="A,B",
        help="degrees of freedom: yaw, surge, ..., or horizontal (default: all that the runs contain)",
    )
    what.add_argument("--use", metavar="A,B", help="signals to compare, e.g. psi,r (default: all measured)")
    tried = what.add_mutually_exclusive_group()
    tried.add_argument("--effects", metavar="A,B", help="effects to try as causes (default: all)")
    tried.add_argument("--without", metavar="A,B", default="", help="effects not to try as causes")
    parser.add_argument(
        "--validate",
        action="extend",
        nargs="+",
        default=[],
        type=Path,
        metavar="RUN",
        help="held-out run for measuring the improvement (default: parts of the runs are held out in turn)",
    )
    add_number(parser, "horizon", "S")
    add_number(parser, "max-seconds", "S")
    parser.add_argument(
        "--resume",
        type=Path,
        metavar="DIR",
        help="continue the stopped search in DIR, with the same runs and options. The results go to DIR",
    )
    add_number(parser, "jobs", "N")
    add_reading(parser)
    add_loudness(parser)
    out = parser.add_argument_group("output")
    out.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="directory for report.html, diagnosis.json and model.json (default diagnose-RUN)",
    )
    out.add_argument("--json", action="store_true", help="print JSON on standard output; write files only with --out")


def _run(args: argparse.Namespace) -> int:
    clock = WallClock()
    begun = clock.now()
    if not args.list_effects:
        check_files(*args.runs, *args.simulation, *args.validate, args.model, args.parameters, args.resume)
        if args.resume is not None and args.out is not None:
            raise UsageError(
                "--resume and --out exclude each other: a resumed search writes to its own directory. Leave out --out"
            )
    with waiting(args, "starting"):
        from gcs_autotune.report import diagnosis_document
        from gcs_autotune.workflow import DiagnosisSettings, run_diagnosis, write_diagnosis

    if args.list_effects:
        from gcs_autotune.effects import EFFECTS
        from gcs_autotune.report import effects_document

        put_out(effects_document(EFFECTS), as_json=args.json)
        return 0
    if len(args.runs) == 1:
        from gcs_autotune.diagnose import diagnose_table, is_parameter_table, read_parameter_table

        if is_parameter_table(args.runs[0]):
            from gcs_autotune.report import parameter_table_document

            own = argparse.ArgumentParser(add_help=False)
            _add_arguments(own)
            typed = [
                a.option_strings[0] for a in own._actions if a.option_strings and getattr(args, a.dest) != a.default
            ]
            if wrong := [name for name in typed if name not in OF_A_TABLE]:
                raise UsageError(
                    f"{args.runs[0]} is a table of parameters, not a run, so {' and '.join(wrong)} cannot apply. Its "
                    f"only options are {' and '.join(OF_A_TABLE)}"
                )
            table = read_parameter_table(args.runs[0])
            put_out(parameter_table_document(table.name, diagnose_table(table)), as_json=args.json)
            return 0
    with waiting(args, "reading the runs"):
        runs = read_runs(args)
        simulations, others = read_others(args, args.simulation), read_others(args, args.validate)
    directory, replaced = args.resume or args.out, ""
    if directory is None and not args.json:
        directory = fresh(Path(f"diagnose-{args.runs[0].resolve().stem}"))
    if directory is not None and args.resume is None:
        replaced = on_replacing(directory)
    # To draw a page takes about as long as it took to come here, on a machine of any speed.
    until = math.inf if args.max_seconds is None else max(args.max_seconds - 2.0 * (clock.now() - begun), 0.0)
    settings = DiagnosisSettings(
        dof=args.dof,
        use=_names(args.use) or None,
        model=args.model,
        simulations=tuple(simulations),
        effects=None if args.effects is None else _names(args.effects),
        without=_names(args.without),
        jobs=args.jobs if args.jobs > 0 else os.cpu_count() or 1,
        horizon=args.horizon,
        max_seconds=until,
        keep=directory,
        resume=args.resume is not None,
    )
    with progress_bar(args, until) as bar:
        told = run_diagnosis(runs, others, settings, bar)
    lines = []
    if directory is not None:
        with waiting(args, "writing the report"):
            page = write_diagnosis(told, directory, datetime.now().isoformat(timespec="seconds"), runs)
        lines.append(f"Report: {page}{replaced}")
    if told.verdict == "unfinished":
        lines.append(f"Not finished. Run the same command with --resume {shlex.quote(str(directory))} to continue.")
    put_out(diagnosis_document(told), *lines, as_json=args.json)
    return 0


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(piece.strip() for piece in (text or "").split(",") if piece.strip())


COMMAND = Command(
    description="Compare measured runs with a simulation of the same commands, identify what the simulation lacks, and "
    "measure the improvement on held-out data. The simulation is a plain model, or --model, or --simulation. Every "
    "verdict exits with code 0. Searches are limited by work, not by time: every machine gives the same result. "
    "A CSV file with the columns level, inertia and drag is a table of identified parameters: it reports rows that "
    "contradict each other.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "model",
        "simulation",
        "validate",
        "dof",
        "effects",
        "list-effects",
        "columns",
        "full-scale",
        "resume",
        "out",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune diagnose runs/LAST", "what the plain model of a run lacks"),
        ("gcs-autotune diagnose day1.csv --validate day2.csv", "prove the causes on another run"),
        ("gcs-autotune diagnose lake.bin --simulation sitl.bin", "what a simulation gets wrong"),
    ),
)
