"""``gcs-autotune study``: run many simulated cases, monitor them and report them."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from gcs_autotune.cli.command import Command, add_loudness, add_number, check_files, progress_bar
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    run = actions.add_parser("run", help="run the cases of a study file that its results folder does not contain")
    run.add_argument("study", type=Path, metavar="STUDY.toml", help="what is varied, and what is done with each case")
    run.add_argument("--out", type=Path, metavar="DIR", help="results folder (default: STUDY beside the study file)")
    add_number(run, "workers", "N")
    run.add_argument(
        "--scheduler", default="", metavar="tcp://HOST:PORT", help="use the Dask cluster of this scheduler"
    )
    add_loudness(run)
    run.set_defaults(json=False)


def _run(args: argparse.Namespace) -> int:
    return _ACTIONS[args.action](args)


def _study(args: argparse.Namespace) -> int:
    check_files(args.study)
    from gcs_autotune.cli import make_parser
    from gcs_autotune.executor import DaskExecutor, Executor
    from gcs_autotune.study import Started, check_plan, cluster_of, given_up, load_plan, run_study, unsuited

    plan = load_plan(args.study)
    check_plan(plan, lambda line: make_parser(only=line[0]).parse_args(line))
    folder = args.out or args.study.with_suffix("")

    def report(text: str) -> None:
        sys.stderr.write(f"{visible(text)}\n")

    with cluster_of(round(args.workers), args.scheduler) as client, progress_bar(args) as bar:

        def executor(started: Started) -> Executor:
            return DaskExecutor(
                client,
                in_order=False,
                lost=partial(given_up, started),
                unsuited=partial(unsuited, started),
                reports=report,
            )

        run_study(
            plan,
            folder,
            executor,
            dashboard=client.dashboard_link or "",
            reports=report,
            progress=lambda done, total: bar("cases", done, total),
        )
    sys.stdout.write(f"{visible(plan.title)}: {len(plan)} cases in {folder}\n")
    return 0


_ACTIONS = {"run": _study}

COMMAND = Command(
    description="Run a study: many simulated tunes, flights, fits or diagnoses over ranges of numbers, on this "
    "computer or on a Dask cluster. A stopped study continues with the same command.",
    add_arguments=_add_arguments,
    run=_run,
)
