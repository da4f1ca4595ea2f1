"""Export identified models to other simulators with :func:`export_model`.

Each target has one module and one row in a table.

``equations`` converts a model into mass matrix, force terms and inputs (SNAME, Fossen2011). Each target writes the
equations in its format. Elements of the model that a target cannot express are always reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gcs_autotune.export.equations import ForceTerm, MotionEquations, equations_of
from gcs_autotune.export.fossen import to_fossen
from gcs_autotune.export.gazebo import to_gazebo
from gcs_autotune.export.matlab import to_matlab
from gcs_autotune.export.table import to_csv
from gcs_autotune.export.vehicle_file import to_vehicle_file
from gcs_autotune.identify import ModelFile
from gcs_autotune.registry import lookup

__all__ = ["TARGETS", "Exported", "ForceTerm", "MotionEquations", "Target", "equations_of", "export_model"]


@dataclass(frozen=True, slots=True)
class Target:
    """An export format.

    - ``suffix``: file suffix.
    - ``help``: one line of help.
    - ``write``: function that returns the text, and sentences about what the format cannot express.
    """

    suffix: str
    help: str
    write: Callable[[MotionEquations], tuple[str, tuple[str, ...]]]


TARGETS: Mapping[str, Target] = {
    "ardupilot-json": Target(".toml", "vehicle file for `gcs-autotune sitl FILE --ardupilot-json`", to_vehicle_file),
    "gazebo": Target(".sdf", "Gazebo's Hydrodynamics plugin", to_gazebo),
    "fossen": Target(".py", "vehicle class for Fossen's Python Vehicle Simulator", to_fossen),
    "matlab": Target(".m", "MATLAB function of the equations of motion, with an example", to_matlab),
    "csv": Target(".csv", "parameters with units and standard errors", to_csv),
}
"""Name -> export format."""


@dataclass(frozen=True, slots=True)
class Exported:
    """A model for another simulator: text, usual file suffix, and sentences about omitted elements of the model."""

    text: str
    suffix: str
    left: tuple[str, ...]


def export_model(file: ModelFile, target: str, full_scale: Mapping[str, float] | None = None) -> Exported:
    """Return the model of *file* in the format of *target*, a name in :data:`TARGETS`.

    full_scale : input -> force [N or N m] at full output, if *target* needs it and *file* does not contain it.

    Raises
    ------
    UnknownName
        There is no such target.
    UsageError
        The target cannot express the model.
    """
    chosen = lookup(TARGETS, target, "target")
    equations = equations_of(file, full_scale or {})
    text, more = chosen.write(equations)
    return Exported(text, chosen.suffix, (*equations.left, *more))
