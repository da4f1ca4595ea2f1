"""The cases: runs to diagnose, held-out runs, and degrees of freedom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from benchmarks.real_diagnosis.clones import BASIN, ESSO, FERRY, KVLCC2, READERS, ROV, clone_of
from gcs_autotune.trial import Trial, load_trial

__all__ = ["CASES", "DATA", "Case"]

DATA = Path(__file__).parents[3] / "shared" / "data"

ROVER = {"t_sim": "t[s]", "heading_deg": "psi[deg]", "yawrate_dps": "r[deg/s]", "cmd": "N[1]"}
SUB_YAW = {"t_sim": "t[s]", "y": "psi[deg]", "ydot": "r[deg/s]", "cmd": "N[1]"}
SUB_DEPTH = {"t_sim": "t[s]", "y": "z[m]", "ydot": "w[m/s]", "cmd": "Z[1]", "z": "true_z", "vz": "true_w"}
"""Columns of the recorder -> columns of this package."""
SUB_YAW_FULL, SUB_DEPTH_FULL = {"N": 2000.0}, {"Z": 1000.0}
"""Commands for full output.

The sub's commands are axes of MANUAL_CONTROL in thousandths (the vertical one of half its range). The autopilot uses
half of them (JS_GAIN_DEFAULT 0.5). In the servo columns of the files, 1000 gives 200 of 400 us, and 250 down gives 100.
"""


@dataclass(frozen=True, slots=True)
class Case:
    """Runs of one craft: file names without extension, degrees of freedom as for ``--dof``, columns to rename.

    Without ``unseen`` ones each run is held out in turn. ``full``: channel -> its value at full output.
    ``folder``: below :data:`DATA`, or a repository that is read from a clone (:mod:`.clones`).
    """

    folder: str
    dof: str
    runs: tuple[str, ...]
    unseen: tuple[str, ...]
    columns: Mapping[str, str] = field(default_factory=dict)
    full: Mapping[str, float] = field(default_factory=dict)

    @property
    def lacking(self) -> str:
        """Return the place of the missing data; empty if they exist."""
        if self.folder in READERS:
            return "" if clone_of(self.folder) else f"a clone of {self.folder} below $REAL_DIAGNOSIS_CLONES"
        return "" if (DATA / self.folder).is_dir() else str(DATA / self.folder)

    def load(self) -> tuple[list[Trial], list[Trial]]:
        """Return the runs to diagnose and the held-out ones."""
        found = [[self._load(name) for name in names] for names in (self.runs, self.unseen)]
        return found[0], found[1]

    def _load(self, name: str) -> Trial:
        if self.folder in READERS:
            return READERS[self.folder](name)
        run = load_trial(DATA / self.folder / f"{name}.csv", self.columns)
        shares = {n: replace(run[n], values=run[n].values / full) for n, full in self.full.items()}
        return replace(run, channels={**run.channels, **shares})


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
    "sub-yaw": Case(
        "ardupilot_sitl", "yaw", ("sub_yaw_relay_C500_h5",), ("sub_yaw_relay_C1000_h10",), SUB_YAW, SUB_YAW_FULL
    ),
    "sub-depth": Case(
        "ardupilot_sitl",
        "heave",
        ("sub_depth_relay_C250_h0.1",),
        ("sub_depth_relay_C400_h0.2",),
        SUB_DEPTH,
        SUB_DEPTH_FULL,
    ),
    "milliampere-yaw": Case(FERRY, "yaw", ("maneuvering1",), ()),
    "tank-yaw": Case(BASIN, "yaw", ("11_10_52_sync_0_3dof", "11_57_50_0_3dof"), ()),
    "tank-surge": Case(BASIN, "surge", ("11_10_52_sync_0_3dof", "11_57_50_0_3dof"), ()),
    "kvlcc2-marin-yaw": Case(KVLCC2, "yaw", ("10", "-10", "20", "-20"), ()),
    "esso-yaw": Case(ESSO, "yaw", ("13_29_19", "14_03_39", "14_10_05"), ()),
    "rov-yaw": Case(
        ROV,
        "yaw",
        ("act_3_4_test_2_2016-03-21-15-06-06", "act_3_4_test_5_2016-03-21-15-15-26"),
        ("act_3_4_test_3_2016-03-21-15-09-30",),
    ),
}
"""Name -> case. Do not tune the diagnosis to these runs."""
