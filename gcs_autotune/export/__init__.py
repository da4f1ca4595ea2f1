"""An identified model in the words of other simulators: :func:`export_model`, one file and one line per target.

``equations`` reads a model as mass matrix, force terms and inputs (SNAME, Fossen2011); each target writes them its way.
What a target cannot say is told, never dropped in silence.
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
    """What a model may be written as: file suffix, one line of help, and what writes it.

    ``write`` returns the text and sentences about what it cannot say.
    """

    suffix: str
    help: str
    write: Callable[[MotionEquations], tuple[str, tuple[str, ...]]]


TARGETS: Mapping[str, Target] = {
    "ardupilot-json": Target(".toml", "vehicle file for `gcs-autotune sitl FILE --ardupilot-json`", to_vehicle_file),
    "gazebo": Target(".sdf", "Gazebo's Hydrodynamics plugin", to_gazebo),
    "fossen": Target(".py", "vehicle class for Fossen's Python Vehicle Simulator", to_fossen),
    "matlab": Target(".m", "MATLAB function of the equations of motion, with a demonstration", to_matlab),
    "csv": Target(".csv", "parameters with units and standard errors", to_csv),
}
"""Name -> target."""


@dataclass(frozen=True, slots=True)
class Exported:
    """A model written for somebody else's simulator: text, usual suffix, and what is not in it."""

    text: str
    suffix: str
    left: tuple[str, ...]


def export_model(file: ModelFile, target: str, full_scale: Mapping[str, float] | None = None) -> Exported:
    """Return the model of *file* in the words of *target*, a name in :data:`TARGETS`.

    full_scale : input -> force [N or N m] at full output, where a target wants it and the file does not say.

    Raises
    ------
    UnknownName
        There is no such target. UsageError: the model cannot be said there at all.
    """
    chosen = lookup(TARGETS, target, "target")
    equations = equations_of(file, full_scale or {})
    text, more = chosen.write(equations)
    return Exported(text, chosen.suffix, (*equations.left, *more))
