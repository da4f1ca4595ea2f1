"""Table of what ``tune`` tunes. To add a row, add a file with a :class:`TuneJob` and a line here.

This module does not import the jobs, so that the command line can list them quickly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.axes import AXES

__all__ = ["DESIGN_OPTIONS", "STEP_OPTIONS", "TUNABLES", "Tunable", "tunable"]

STEP_OPTIONS = ("step", "step_duration", "relay_output", "relay_hysteresis", "model", "gains", "omega_0")
"""Options of a tune whose proof is a step."""
DESIGN_OPTIONS = (
    "relays",
    "stop_rule",
    "throttle",
    "speed",
    "full_scale",
    "function",
    "beyond_ranges",
    "settling_time",
)
"""Options of a tune that flies experiments and designs gains from them."""
TWO_AXES = tuple(name for name in STEP_OPTIONS if not name.startswith("step"))
"""Options of a step that a tune of two motions at once has no use for."""


@dataclass(frozen=True, slots=True)
class Tunable:
    """One thing that ``tune`` tunes.

    Attributes
    ----------
    axis : the axis whose settings it uses.
    job : module and attribute of its ``workflow.tune.TuneJob``.
    after : what it stands on: ``tune all`` tunes that before it and checks it again after it; None: not part of that.
    kind : the kind of vehicle (``Firmware.kind``) for which it is part of ``tune all``; empty: every kind.
    on_request : whether ``tune all`` tunes it only if ``--loops`` names it.
    useless : options that it has no use for.
    example : the simulated vehicle used by default; empty: that of the axis.
    """

    name: str
    axis: str
    job: str = "gcs_autotune.workflow.tune:JOB"
    after: tuple[str, ...] | None = None
    kind: str = ""
    on_request: bool = False
    useless: tuple[str, ...] = ("leg_length", "untuned", "pull_test")
    example: str = ""


TUNABLES: Mapping[str, Tunable] = {
    t.name: t
    for t in (
        Tunable("speed", "speed", after=(), useless=("leg_length", "untuned")),
        Tunable("heading", "heading", after=()),
        Tunable("depth", "depth", after=()),
        Tunable("roll", "roll", after=(), on_request=True),  # most ROVs right themselves
        Tunable("pitch", "pitch", after=(), on_request=True),
        Tunable(
            "line",
            "heading",
            "gcs_autotune.workflow.line:JOB",
            after=("speed", "heading"),
            useless=(*STEP_OPTIONS, *DESIGN_OPTIONS, "resume", "pull_test"),
        ),
        Tunable(
            "actuators",
            "speed",
            "gcs_autotune.workflow.actuators:JOB",
            useless=(
                "relay_output",
                "relay_hysteresis",
                "model",
                "gains",
                "omega_0",
                "resume",
                "leg_length",
                "untuned",
            ),
        ),
        Tunable(
            "position",
            "depth",
            "gcs_autotune.workflow.position:JOB",
            after=(),  # its gains change neither the heading nor the depth loop, so neither is rechecked
            kind="rov",
            on_request=True,  # few ROVs know their position
            useless=(*TWO_AXES, "leg_length", "resume", "settling_time", "untuned", "pull_test"),
            example="sitl:bluerov2-sway",
        ),
    )
}
"""Name -> what is tuned, in the order of ``tune all``. An axis without a row is tuned only by its name."""


def tunable(name: str) -> Tunable:
    """Return the row of *name*, or that of an axis without a row; ``KeyError`` if there is none."""
    return TUNABLES.get(name) or Tunable(AXES[name].name, name)
