"""The cases: which runs are diagnosed, which are only foretold, which degrees of freedom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gcs_autotune.trial import Trial, load_trial

__all__ = ["CASES", "DATA", "Case"]

DATA = Path(__file__).parents[3] / "shared" / "data"

ROVER = {"t_sim": "t[s]", "heading_deg": "psi[deg]", "yawrate_dps": "r[deg/s]", "cmd": "N[1]"}
SUB_YAW = {"t_sim": "t[s]", "y": "psi[deg]", "ydot": "r[deg/s]", "cmd": "N[1]"}
SUB_DEPTH = {"t_sim": "t[s]", "y": "z[m]", "ydot": "w[m/s]", "cmd": "Z[1]", "z": "true_z", "vz": "true_w"}
"""Heads of the recorder's own names."""


@dataclass(frozen=True, slots=True)
class Case:
    """Runs of one craft: file names without ending, degrees of freedom as for ``--dof``, heads to be renamed.

    Without ``unseen`` ones the runs are left out in turn.
    """

    folder: str
    dof: str
    runs: tuple[str, ...]
    unseen: tuple[str, ...]
    columns: Mapping[str, str] = field(default_factory=dict)

    def load(self) -> tuple[list[Trial], list[Trial]]:
        """Return the runs to diagnose and those to foretell."""
        found = [
            [load_trial(DATA / self.folder / f"{name}.csv", self.columns) for name in names]
            for names in (self.runs, self.unseen)
        ]
        return found[0], found[1]


CASES: Mapping[str, Case] = {
    "blueboat-yaw": Case("blueboat", "yaw", ("run228", "run224", "run234"), ("run225", "run230")),
    "blueboat-surge": Case("blueboat", "surge", ("run218", "run220"), ("run216",)),
    "blueboat-coupled": Case("blueboat", "surge,yaw", ("run228", "run224", "run218"), ("run225", "run216")),
    "kvlcc2-yaw": Case("kvlcc2_hsva", "yaw", ("Z_10_05", "Z_20_10_P"), ("Z_20_05", "Z_10_10_S")),
    "blueboat-yaw-apart": Case("blueboat", "yaw", ("run228", "run230", "run216"), ()),
    "kvlcc2-yaw-all": Case(
        "kvlcc2_hsva", "yaw", ("Z_05_01", "Z_10_01", "Z_10_05", "Z_10_10_S", "Z_20_05", "Z_20_10_P", "Z_30_05"), ()
    ),
    "rover-yaw": Case("ardupilot_sitl", "yaw", ("rover_relay_C0.1_h5",), ("rover_relay_C0.2_h5",), ROVER),
    "sub-yaw": Case("ardupilot_sitl", "yaw", ("sub_yaw_relay_C500_h5",), ("sub_yaw_relay_C1000_h10",), SUB_YAW),
    "sub-depth": Case(
        "ardupilot_sitl", "heave", ("sub_depth_relay_C250_h0.1",), ("sub_depth_relay_C400_h0.2",), SUB_DEPTH
    ),
}
"""Name -> case. More runs of the same craft exist elsewhere; these are for looking at, not for tuning to."""
