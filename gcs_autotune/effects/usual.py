"""The bounds of every effect's parameters on a craft everybody can scale: for lists; fits use those of the runs.

The craft: largest command 1 (N, N m or rad), time constant 1 s, standard deviation 1 of every signal, one run of 60 s
sampled at 10 Hz. A bound of a command scales with the largest command, one of a time with the time constant.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_autotune.effects.effect import Effect, Scene
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = ["CRAFT", "usual_bounds"]

CRAFT = "largest command 1, time constant 1 s, signals of standard deviation 1, one run of 60 s at 10 Hz"

DURATION, INTERVAL, PACE = 60.0, 0.1, 1.0
NOISE = 0.01
_UNITS = {**dict.fromkeys("XYZ", "N"), "N": "N m", "delta": "rad"}


def usual_bounds(effect: Effect) -> Mapping[str, tuple[float, float]]:
    """Return parameter -> (smallest, largest) at the first place that has it; infinite where there is no bound.

    Raises
    ------
    LookupError
        None of the craft here has a place for it.
    """
    for scene in _SCENES:
        for place in effect.places(scene):
            bounds = effect.bounds(place, scene)
            return {q.name: bounds.get(q.name, (-float("inf"), float("inf"))) for q in effect.parameters}
    raise LookupError(f"{effect.slug} has no place on any of the craft here: add one that has it")


def _scene(dofs: tuple[str, ...], drives: Mapping[str, str], signals: tuple[str, ...], *, drag: bool = True) -> Scene:
    inputs = {channel: ((DOFS[dof].force, 1.0),) for channel, dof in drives.items()}
    base: dict[str, float] = {}
    for dof in dofs:
        d = DOFS[dof]
        base |= {f"{d.force}_{d.velocity}dot": -1.0} | ({f"{d.force}_{d.velocity}": -1.0 / PACE} if drag else {})
    form = Form("plain", "a craft everybody can scale", dofs, tuple(base), {}, inputs, coriolis=False)
    return Scene(
        form=form,
        inputs={c: _UNITS[c] for c in drives},
        signals={s: SIGNALS[s][0] for s in signals},
        swing=dict.fromkeys(drives, 1.0),
        spread=dict.fromkeys(signals, 1.0),
        level=dict.fromkeys(signals, NOISE),
        channels=frozenset((*drives, *signals)),
        interval=INTERVAL,
        pace=PACE,
        duration=DURATION,
        quantum=dict.fromkeys(signals, 0.0),
        extent=dict.fromkeys((*drives, *signals), (-1.0, 1.0)),
        rms=dict.fromkeys((*drives, *signals), 1.0),
        base=base,
        runs=("run1", "run2"),
    )


_SCENES = (
    _scene(
        ("surge", "sway", "heave", "yaw"),
        {"X": "surge", "Y": "sway", "Z": "heave", "N": "yaw"},
        ("u", "v", "w", "r", "psi", "x", "y", "z"),
    ),
    _scene(("yaw",), {"delta": "yaw"}, ("r", "psi", "u")),
    _scene(("yaw",), {"N": "yaw"}, ("r", "psi"), drag=False),
)
"""All but yaw by a rudder; that; and a craft without linear drag."""
