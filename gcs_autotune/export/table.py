"""Export a model's parameters as CSV, one parameter per row."""

from __future__ import annotations

import csv
import io
import math

from gcs_autotune.export.equations import MotionEquations

__all__ = ["to_csv"]


def to_csv(equations: MotionEquations) -> tuple[str, tuple[str, ...]]:
    """Return the parameters as ``name,value,unit,std`` rows, and an empty list of omissions.

    An unknown standard error is an empty cell.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("name", "value", "unit", "std"))
    for name, value, unit, std in equations.parameters:
        writer.writerow((name, repr(value), unit, repr(std) if math.isfinite(std) else ""))
    return stream.getvalue(), ()
