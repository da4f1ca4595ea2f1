"""``gcs-autotune export``: write an identified model in the format of another simulator."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcs_autotune.cli.command import Command, check_files, waiting
from gcs_autotune.cli.reading import full_scale
from gcs_autotune.cli.writing import folded, fresh, on_replacing
from gcs_autotune.documents import MODEL, model_file
from gcs_autotune.errors import BadFile
from gcs_autotune.untrusted_text import visible

__all__ = ["COMMAND"]

TARGETS = ("ardupilot-json", "gazebo", "fossen", "matlab", "csv")
"""Names of ``export.TARGETS``, listed here because importing that takes a second."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "model",
        type=Path,
        metavar="MODEL",
        help="model file written by identify --save, tune or diagnose, or a run directory",
    )
    parser.add_argument("--to", required=True, choices=TARGETS, help="program that reads the exported model")
    parser.add_argument(
        "--full-scale",
        metavar="X=F,N=F",
        default="",
        help="force [N] or moment [N m] at full output, for a model that does not state it (ardupilot-json)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write (default MODEL with the target's suffix)"
    )


def _run(args: argparse.Namespace) -> int:
    check_files(args.model)
    with waiting(args, "reading the model"):
        from gcs_autotune.export import export_model
        from gcs_autotune.identify import load_model

        written = export_model(load_model(args.model), args.to, full_scale(args.full_scale))
    source = model_file(args.model)
    path: Path = args.out or fresh(source.with_suffix(written.suffix))
    replaced = on_replacing(path)
    try:
        path.write_text(written.text, encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}. Choose another --out") from error
    others = sorted(source.parent.glob("model-*.json")) if source.name == MODEL else []
    for what in (*written.left, *(f"{other}. Export this model of the same run separately" for other in others)):
        sys.stderr.write(folded(f"Not exported: {visible(what)}", sys.stderr, "  "))
    sys.stdout.write(f"Model for {args.to}: {visible(str(path))}{replaced}\n")
    return 0


COMMAND = Command(
    description="Write an identified model for another simulator, with the effects that its format can express. "
    "Effects that it cannot express are listed on standard error and in the file.",
    add_arguments=_add_arguments,
    run=_run,
)
