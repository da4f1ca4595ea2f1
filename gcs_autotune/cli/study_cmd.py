"""``gcs-autotune study``: run many simulated cases, monitor them and report them."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from contextlib import ExitStack
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.cli.command import Command, add_loudness, add_number, check_files, progress_bar, waiting
from gcs_autotune.cli.writing import fresh, on_replacing, page_file, put_out
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.study import StudyProgress

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
    watch = actions.add_parser("watch", help="show how far a study is, until it ends")
    _add_folder(watch)
    watch.add_argument("--once", action="store_true", help="show it once (always, if the output is not a terminal)")
    report = actions.add_parser("report", help="show success rates, maps, distributions and the worst cases")
    _add_folder(report)
    report.add_argument("--against", type=Path, metavar="DIR", help="compare with an earlier study of the same file")
    report.add_argument("--page", type=page_file, metavar="FILE", help="file for the page (default DIR/report.html)")
    report.add_argument("--json", action="store_true", help="print JSON on standard output; no page unless --page")
    replay = actions.add_parser("replay", help="repeat one case, keep its files and show its results")
    _add_folder(replay)
    replay.add_argument("case", metavar="CASE", help="first digits of the case's key, as `study report` shows them")
    replay.add_argument("--out", type=Path, metavar="DIR", help="folder for the case's files (default DIR/replay-CASE)")


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="results folder of the study")


def _run(args: argparse.Namespace) -> int:
    return _ACTIONS[args.action](args)


def _study(args: argparse.Namespace) -> int:
    check_files(args.study)
    with waiting(args, "starting"):
        from gcs_autotune.cli import make_parser
        from gcs_autotune.executor import DaskExecutor, Executor
        from gcs_autotune.link import open_link
        from gcs_autotune.study import (
            Started,
            check_plan,
            cluster_of,
            given_up,
            load_plan,
            progress_of,
            run_study,
            unsuited,
        )

        plan = load_plan(args.study)
        check_plan(plan, lambda line: make_parser(only=line[0]).parse_args(line), lambda link: open_link(link).close())
    folder = args.out or args.study.with_suffix("")

    def report(text: str) -> None:
        sys.stderr.write(f"{visible(text)}\n")

    with ExitStack() as cluster:
        with waiting(args, "starting the workers"):
            client = cluster.enter_context(cluster_of(round(args.workers), args.scheduler))
        bar = cluster.enter_context(progress_bar(args))

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
    found = progress_of(folder)
    lost = f", {found.failed} failed, {found.given_up} given up" if found.done < len(plan) else ""
    sys.stdout.write(
        f"{visible(plan.title)}: {found.done} of {len(plan)} cases done{lost}. The results are in the folder {folder}\n"
        f"Next: gcs-autotune study report {shlex.quote(str(folder))}\n"
    )
    return 0


def _watch(args: argparse.Namespace) -> int:
    from gcs_autotune.study import progress_of

    terminal = sys.stdout.isatty() and not args.once
    while True:
        found = progress_of(args.folder)
        sys.stdout.write(("\r\x1b[K" if terminal else "") + _line(found) + ("" if terminal else "\n"))
        sys.stdout.flush()
        if not terminal or not found.running:
            break
        time.sleep(_EVERY)
    sys.stdout.write("\n" if terminal else "")
    if found.running and found.dashboard:
        sys.stdout.write(f"Dask's dashboard: {visible(found.dashboard)}\n")
    return 0


def _line(found: StudyProgress) -> str:
    counts = f"{found.done} of {found.cases} done, {found.failed} failed, {found.given_up} given up"
    if not found.left:
        return f"{visible(found.title)}: {counts}"
    if not found.running:
        return f"{visible(found.title)}: {counts}; stopped. `study run` continues it"
    left = timedelta(seconds=round(found.left)) if found.rate else "unknown"
    return f"{visible(found.title)}: {counts}; {3600.0 * found.rate:.0f} an hour, time left {left}"


def _report(args: argparse.Namespace) -> int:
    from gcs_autotune.report import case_study_document, to_html
    from gcs_autotune.study import case_study_of

    document = case_study_document(case_study_of(args.folder, args.against))
    page = args.page or (None if args.json else args.folder / "report.html")
    lines = []
    if page is not None:
        lines = [f"Report: {page}{on_replacing(page) if args.page else ''}"]
        page.write_text(to_html(document), encoding="utf-8")
    put_out(document, *lines, as_json=args.json)
    return 0


def _replay(args: argparse.Namespace) -> int:
    from gcs_autotune.study import Case, Started, Store, commands_of, other_code, plan_of, play

    store = Store(args.folder)
    plan = plan_of(store)
    index, given = store.row(args.case)
    folder = args.out or fresh(args.folder / f"replay-{args.case}")
    folder.mkdir(parents=True, exist_ok=True)
    case = Case(index, given)
    if why := other_code(store, plan):
        sys.stderr.write(f"The results may differ from those stored. This is {visible(why)}\n")
    for line in commands_of(plan.do, given, folder, plan.home):
        sys.stdout.write(f"{shlex.join(['gcs-autotune', *line])}\n")
    row = play(Started.of(plan), case, folder)
    sys.stdout.write(f"{row.status}{': ' + visible(row.reason) if row.reason else ''}\n")
    for name, value in {**row.numbers, **row.texts}.items():
        sys.stdout.write(f"  {visible(f'{name}: {value}')}\n")
    sys.stdout.write(f"Files: {folder}\n")
    return 0 if row.status == "done" else 1


_ACTIONS = {"run": _study, "watch": _watch, "report": _report, "replay": _replay}
_EVERY = 2.0
"""Time [s] between two looks at a study. Project choice."""

COMMAND = Command(
    description="Run a study: many simulated tunes, flights, fits or diagnoses over ranges of numbers, on this "
    "computer or on a Dask cluster. A stopped study continues with the same command.",
    add_arguments=_add_arguments,
    run=_run,
)
