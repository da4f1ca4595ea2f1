"""How fast: the lock-stepped vehicle against real time, and a whole ``tune heading``.

Run: ``python3 -m benchmarks.speed``. The first tune on a machine also compiles the kernels; both are shown.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from gcs_autotune.craft import Actuate
from gcs_autotune.link import Session, open_craft, open_link
from gcs_autotune.workflow.connection import SERVO_RATE

CONTROL_RATE = 10.0
SIMULATED = 600.0


def real_time_factor(vehicle: str) -> float:
    """Fly *vehicle* in manual mode at 10 Hz control for ten simulated minutes; return simulated over wall time."""
    with open_link(f"sitl:{vehicle}") as link, Session(link) as session:
        rates = {
            "ATTITUDE": CONTROL_RATE,
            "SERVO_OUTPUT_RAW": SERVO_RATE,
            "GLOBAL_POSITION_INT": 10.0,
            "VFR_HUD": 5.0,
        }
        craft = open_craft(session, wanted_rates=rates)
        craft.set_mode(craft.firmware.manual_mode)
        craft.arm()
        begun, start = time.perf_counter(), session.clock.now()
        sign = 1.0
        while session.clock.now() - start < SIMULATED:
            seen = craft.observe()
            sign = -sign if abs(seen.r) > 0.1 and seen.r * sign > 0 else sign
            craft.send(Actuate(X=0.3, N=0.3 * sign))
        return (session.clock.now() - start) / (time.perf_counter() - begun)


def tune_seconds(axis: str, directory: Path) -> float:
    """Return the wall seconds of one ``gcs-autotune tune`` on the embedded vehicle, report included."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "gcs_autotune", "tune", axis, "--out", str(directory)]
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begun


def main() -> None:
    """Print the table."""
    for vehicle in ("charlie", "videoray"):
        factor = real_time_factor(vehicle)
        print(f"{vehicle:10s} lock-step, {CONTROL_RATE:g} Hz control: {factor:7.0f} x real time (goal 100)")
    with tempfile.TemporaryDirectory() as folder:
        for axis in ("heading", "depth"):
            times = [tune_seconds(axis, Path(folder) / f"{axis}-{i}") for i in range(3)]
            shown = ", ".join(f"{t:.1f}" for t in times)
            print(f"tune {axis:8s} wall: {shown} s (goal under 15)")


if __name__ == "__main__":
    main()
