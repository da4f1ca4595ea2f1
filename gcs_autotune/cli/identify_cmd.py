"""``gcs-autotune identify``: identify a model from recorded runs and write a page of plots."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gcs_autotune.cli.command import Command, add_loudness, add_number, check_files, progress_bar, waiting
from gcs_autotune.cli.reading import add_reading, add_runs, read_others, read_runs
from gcs_autotune.cli.writing import fresh, on_replacing, page_file, put_out, write_page
from gcs_autotune.documents import MODEL
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.methods import METHOD_PLACES
from gcs_autotune.registry import lookup
from gcs_autotune.sname import DOFS
from gcs_autotune_files import Refused, clipped, parse

if TYPE_CHECKING:
    from gcs_autotune.identify import ModelFile
    from gcs_autotune.thrusters import TwinThrusters
    from gcs_autotune.trial import Trial

__all__ = ["COMMAND"]

MOST = 1e12
"""Largest value accepted for a constant of a craft or an option of a method: that of a large ship in SI units. Project
choice.
"""

_FORMS = resources.files("gcs_autotune") / "models" / "coupled" / "forms"
MOTIONS = (*DOFS, *sorted(file.name.removesuffix(".toml") for file in _FORMS.iterdir() if file.name.endswith(".toml")))
"""Names of degrees of freedom and supplied forms, used to reject a typing error before SciPy is imported."""


def _verify_method_known(name: str, *besides: str) -> None:
    lookup(dict.fromkeys((*METHOD_PLACES, *besides)), name, "identification method")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_runs(parser)
    what = parser.add_argument_group("model")
    what.add_argument(
        "--dof",
        choices=MOTIONS,
        metavar="DOF",
        help="yaw, surge, sway, heave, roll, pitch, horizontal or 6dof (default: the excited ones)",
    )
    what.add_argument(
        "--structure",
        metavar="S",
        help="one axis: damping linear, nonlinear (quadratic) or affine (both) (default: chosen from the data). "
        "Coupled model: name of the form, or a TOML file",
    )
    what.add_argument(
        "--known",
        action="append",
        default=[],
        metavar="K=V,..",
        help="known constants of the craft in SI units: m=11,I_z=2.1. x_P=0.3,y_P=-0.1: distance of the speed and "
        "position sensor ahead and to starboard",
    )
    what.add_argument(
        "--plan",
        metavar="PLAN",
        help="identify step by step from a sequence of experiments: usv_6dof, usv_twin or a TOML file (with --known, "
        "--json)",
    )
    what.add_argument(
        "--thrusters",
        type=Path,
        metavar="FILE",
        help="with --plan usv_twin and --spacing: force map of the two thrusters, from `thrusters --json`",
    )
    add_number(what, "spacing", "M")
    add_number(what, "delay", "S")
    what.add_argument(
        "--effects",
        metavar="A,B",
        default="",
        help="effects to fit with the model, as NAME or NAME@CHANNEL: dead-zone@N (see diagnose --list-effects)",
    )
    what.add_argument(
        "--start",
        type=Path,
        metavar="FILE",
        help="model file (from identify --save or diagnose): the fit starts from its structure, effects and values",
    )
    how = parser.add_argument_group("method")
    how.add_argument(
        "--method",
        default="output-error",
        metavar="M",
        help="identification method (default output-error); 'all' compares all methods, 'list' lists them",
    )
    how.add_argument("--use", metavar="A,B", help="signals to fit, e.g. psi,r (default: chosen from the data)")
    how.add_argument("--robust", action="store_true", help="reduce the weight of outliers (soft-L1 loss)")
    how.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="K=V",
        help="option of the method (--method list shows the options)",
    )
    add_reading(parser)
    check = parser.add_argument_group("check")
    check.add_argument(
        "--validate",
        action="append",
        default=[],
        type=Path,
        metavar="RUN",
        help="run used only to test the prediction, not for the fit",
    )
    check.add_argument("--no-check", action="store_true", help="skip the held-out check (faster)")
    check.add_argument("--choose", action="store_true", help="coupled model: remove terms that the runs do not support")
    add_number(check, "plan-next", "S", const=60.0)
    check.add_argument(
        "--profile",
        metavar="A,B",
        default="",
        help="parameters whose intervals are computed by profile likelihood: alpha_r,beta_r",
    )
    add_loudness(parser)
    check.add_argument(
        "--compare",
        metavar="MODEL",
        help="model file or method to compare with, by final value and settling time of a step",
    )
    out = parser.add_argument_group("output")
    out.add_argument(
        "--page", type=page_file, metavar="FILE", help="file for the report page (default identify-RUN.html)"
    )
    out.add_argument("--save", type=Path, metavar="FILE", help="write the model to FILE, for sitl, tune and --start")
    out.add_argument("--no-page", action="store_true", help="write no report page")
    out.add_argument("--json", action="store_true", help="print JSON on standard output; no page unless --page")


def _run(args: argparse.Namespace) -> int:
    known, options = _numbers(args.known), _options("--option", args.option)  # first: a typo waits for no import
    _verify_method_known(args.method, "all", "list")
    if args.thrusters is not None and args.plan is None:
        raise UsageError("--thrusters needs --plan, e.g. --plan usv_twin")
    if (args.thrusters is None) != (args.spacing is None):
        raise UsageError("--thrusters FILE and --spacing M, the distance between the two thrusters, go together")
    if args.compare is not None and not _is_file(args.compare):
        _verify_method_known(args.compare)
    if args.method != "list":
        check_files(*args.runs, *args.validate, args.start, args.parameters)

    with waiting(args, "starting"):
        from gcs_autotune.identify import METHODS, load_model, save_model
        from gcs_autotune.report import method_list, study_document
        from gcs_autotune.workflow import StudySettings, study

    if args.method == "list":
        put_out(method_list(METHODS.values()))
        return 0
    with waiting(args, "reading the runs"):
        runs = read_runs(args)
    if args.plan is not None:
        return _follow(args, runs, known)
    unseen = read_others(args, args.validate)
    begin = args.start or _model_beside(args, runs)
    delay: float | Literal["auto"] = "auto" if args.delay is None else float(args.delay)
    settings = StudySettings(
        dof=args.dof,
        structure=args.structure,
        method=args.method,
        delay=delay,
        use=tuple(args.use.split(",")) if args.use else None,
        loss="soft_l1" if args.robust else "linear",
        options=options,
        known=known,
        effects=tuple(e.strip() for e in args.effects.split(",") if e.strip()),
        begin=None if begin is None else load_model(begin).model,
        check=not args.no_check,
        choose=args.choose,
        plan_next=args.plan_next,
        compare=_other(args.compare, load_model),
        profile=tuple(n.strip() for n in args.profile.split(",") if n.strip()),
    )
    with progress_bar(args) as bar:
        found = study(runs, unseen, settings, datetime.now().isoformat(timespec="seconds"), bar)
    document = study_document(found)
    said = [] if begin == args.start else [f"Structure, effects and start values come from {begin}"]
    if args.save is not None:
        replaced = on_replacing(args.save)
        save_model(found.fit, args.save)
        said.append(f"Model: {args.save}{replaced}")
    page = _page(args)
    if page is not None:
        with waiting(args, "writing the report"):
            said.append(write_page(document, page, *args.runs, *args.validate, begin, args.parameters, args.save))
    put_out(document, *said, as_json=args.json)
    return 0


def _follow(args: argparse.Namespace, runs: Sequence[Trial], known: Mapping[str, float]) -> int:
    """Identify step by step, following a plan."""
    from gcs_autotune.identify.plan import load_plan, run_plan
    from gcs_autotune.report import plan_document

    if args.thrusters is not None:
        twin = _twin(args)
        runs = [twin.forces_of(run) for run in runs if {"X", "N"} <= run.channels.keys()]
    plan = load_plan(args.plan).knowing(known)
    if any("X_port" in step.form.inputs for step in plan.steps) and not any("X_port" in run for run in runs):
        raise UsageError(f"plan '{plan.name}' needs the forces of both thrusters. Add --thrusters MAP.json --spacing M")
    if args.delay is not None:
        plan = replace(plan, steps=tuple(replace(step, delay=args.delay) for step in plan.steps))
    if args.method != "output-error":
        plan = replace(plan, steps=tuple(replace(step, method=args.method) for step in plan.steps))
    put_out(plan_document(run_plan(plan, runs)), as_json=args.json)
    return 0


def _twin(args: argparse.Namespace) -> TwinThrusters:
    """Return the two thrusters with the map in ``--thrusters``, at the distance ``--spacing``."""
    from gcs_autotune.documents import load_json
    from gcs_autotune.thrusters import ThrusterMap, TwinThrusters

    data = load_json(args.thrusters, "a thruster map")
    try:
        own = ThrusterMap.from_dict(data["model"])
    except (KeyError, TypeError) as error:
        raise BadFile(
            f"{args.thrusters} is not a thruster map. Write one with `gcs-autotune thrusters PULLS.csv --json`"
        ) from error
    return TwinThrusters(own, own, args.spacing)


def _model_beside(args: argparse.Namespace, runs: Sequence[Trial]) -> Path | None:
    """Return the model file of the one run directory given, if its *runs* were fitted with effects.

    Without these effects the model may not explain the runs. Return None for other options, or if the runs alone
    determine the thrust curve.
    """
    from gcs_autotune.identify import load_model

    asked = (args.dof, args.structure, args.known, args.effects, args.option, args.choose, args.start)
    file = args.runs[0] / MODEL
    alone = all(run.meta.get("thrust_curve") is True for run in runs)
    if alone or len(args.runs) > 1 or any(asked) or args.method != "output-error" or not file.is_file():
        return None
    effects = {effect.slug for effect in load_model(file).model.effects}
    return file if effects - {"input-delay"} else None  # a delay alone is fitted by every identification


def _other(text: str | None, load: Callable[[Path], ModelFile]) -> ModelFile | str | None:
    """Return the model to compare with, read from a file, or the name of a method."""
    return load(Path(text)) if text is not None and _is_file(text) else text


def _is_file(text: str) -> bool:
    """Return whether *text* is a file name rather than a method."""
    return bool(Path(text).suffix) or Path(text).exists()


def _numbers(pairs: list[str]) -> dict[str, float]:
    """Parse ``--known K=V[,K=V ...]`` with numbers only."""
    found = {}
    for name, value in _options("--known", [pair.strip() for text in pairs for pair in text.split(",")]).items():
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            raise UsageError(f"--known {name}={value}: not a number. Write e.g. --known m=11")
        found[name] = float(value)
    return found


def _page(args: argparse.Namespace) -> Path | None:
    if args.page is not None:
        path: Path = args.page
        return path
    if args.no_page or args.json:
        return None
    return fresh(Path(f"identify-{args.runs[0].resolve().stem}.html"))


def _options(flag: str, pairs: list[str]) -> dict[str, Any]:
    """Parse ``K=V``. The value is a number, true or false, a list with commas, or text."""
    found: dict[str, Any] = {}
    for pair in pairs:
        key, sign, value = pair.partition("=")
        if not sign or not key:
            raise UsageError(f"{flag} {clipped(pair)}: not NAME=VALUE. Write e.g. m=11")
        if value.strip().lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise UsageError(f"{flag} {clipped(pair)}: the value is not a finite number. Write a number")
        found[key] = _value(flag, pair, value)
        if isinstance(found[key], (int, float)) and not abs(found[key]) <= MOST:
            raise UsageError(f"{flag} {clipped(pair)}: too large. The largest allowed is {MOST:g}")
    return found


def _value(flag: str, pair: str, text: str) -> Any:
    try:
        return parse(text)
    except Refused as error:
        if text.strip()[:1] in tuple("-+.0123456789[{"):
            raise UsageError(f"{flag} {clipped(pair)}: {error}") from None
        return text


COMMAND = Command(
    description="Identify one degree of freedom, alpha*nu_dot + (beta + beta_nn*|nu|)*nu = tau + delta, or a coupled "
    "model (--dof horizontal, --dof 6dof) from run directories, CSV files with columns like t[s], psi[rad], "
    "r[rad/s], N[N m], telemetry logs (.tlog) or onboard logs (.bin). Several runs are fitted together.",
    add_arguments=_add_arguments,
    run=_run,
    everyday=(
        "dof",
        "structure",
        "validate",
        "choose",
        "columns",
        "parameters",
        "full-scale",
        "save",
        "page",
        "verbose",
        "json",
    ),
    examples=(
        ("gcs-autotune identify zigzag.csv", "a table with units in its header"),
        ("gcs-autotune identify flight.bin --dof yaw --save boat.json", "a dataflash log, and the model as a file"),
        ("gcs-autotune identify a.csv --validate b.csv", "fit one run, predict another"),
    ),
)
