"""``gcs-autotune export``: an identified model in the words of another simulator."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, see_files
from gcs_autotune.cli.reading import full_scale
from gcs_autotune.cli.writing import fresh, on_replacing
from gcs_autotune.errors import BadFile
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]

TARGETS = ("ardupilot-json", "gazebo", "fossen", "matlab", "csv")
"""Names of ``export.TARGETS``, told here because that takes a second to import."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path, metavar="MODEL", help="model file of identify --save, tune or diagnose")
    parser.add_argument("--to", required=True, choices=TARGETS, help="for whom")
    parser.add_argument(
        "--full-scale",
        metavar="X=F,N=F",
        default="",
        help="force [N] or moment [N m] at full output, where the model does not say (ardupilot-json)",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="where it goes (default MODEL with its own suffix)")


def _run(args: argparse.Namespace) -> int:
    see_files(args.model)
    from gcs_autotune.export import export_model
    from gcs_autotune.identify import load_model

    written = export_model(load_model(args.model), args.to, full_scale(args.full_scale))
    path: Path = args.out or fresh(args.model.with_suffix(written.suffix))
    replaced = on_replacing(path)
    try:
        path.write_text(written.text, encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}") from error
    for what in written.left:
        sys.stderr.write(f"not in it: {visible(what)}\n")
    sys.stdout.write(f"{visible(str(path))}{replaced}\n")
    return 0


COMMAND = Command(
    name="export",
    help="write a model for ArduPilot's simulator, Gazebo, Fossen's simulator, MATLAB or as a table",
    description="Write an identified model, effects included as far as they can be said there, for another simulator. "
    "What a target cannot say is told on standard error and in the file.",
    add_arguments=_add_arguments,
    run=_run,
)
