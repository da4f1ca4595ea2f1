"""A command imports only what it needs: no MAVLink to read a table, no numerics to print help."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TABLES = {
    "our own": "t[s],psi[rad],r[rad/s],N[N m]\n" + "".join(f"{0.1 * k:.1f},0.{k % 10},0.0,1\n" for k in range(40)),
    "of MAVLink messages": "timestamp,HEARTBEAT.type,HEARTBEAT.autopilot,HEARTBEAT.base_mode,HEARTBEAT.custom_mode,"
    "ATTITUDE.time_boot_ms,ATTITUDE.roll,ATTITUDE.pitch,ATTITUDE.yaw\n"
    + "".join(f"{1.6e9 + k:.1f},11,3,129,0,,,,\n{1.6e9 + k + 0.1:.1f},,,,,{1000 * k},0.0,0.0,0.1\n" for k in range(9)),
    "of QGroundControl": "Timestamp,roll,pitch,heading\n2024-05-01 10:00:00.000,0,0,90\n",
}
WIRE = ("pymavlink", "serial", "mavsdk", "gcs_autotune.link")
NUMERICS = ("numpy", "scipy", "numba", "matplotlib", "control", "pymavlink", "serial")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in /proc")
@pytest.mark.parametrize("theirs", [None, "2"])
def test_a_command_uses_one_thread_by_default(theirs: str | None) -> None:
    """Two threads wait for each other if other programs run: the tests of two records took 167 s for 25 s."""
    counting = (
        "import os\nfrom gcs_autotune.cli import main\nmain(['fly', '--list'])\nimport numpy\n"
        "print(len(os.listdir('/proc/self/task')), os.environ['OPENBLAS_NUM_THREADS'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment |= {"OPENBLAS_NUM_THREADS": theirs} if theirs else {}
    run = subprocess.run(
        [sys.executable, "-c", counting], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    threads, asked = run.stdout.split()[-2:]
    assert asked == (theirs or "1")
    assert threads == "1" or theirs


def imported(code: str, *arguments: str) -> set[str]:
    """Run *code* in a fresh interpreter and return the modules it had imported at its end."""
    program = f"import sys\n{code}\nimport json\nprint('\\n' + json.dumps(sorted(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", program, *arguments], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(json.loads(run.stdout.splitlines()[-1]))


@pytest.mark.parametrize("table", list(TABLES))
def test_reading_a_table_imports_neither_mavlink_nor_serial_ports(table: str, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(TABLES[table])
    reading = (
        "from pathlib import Path\nfrom gcs_autotune.logs import load_runs, record\n"
        "assert record(Path(sys.argv[1])) or load_runs(sys.argv[1])"
    )
    modules = imported(reading, str(tmp_path / "run.csv"))
    assert "gcs_autotune.logs.files" in modules
    assert modules.isdisjoint(WIRE)


def test_a_parameter_file_is_read_without_mavlink(tmp_path: Path) -> None:
    (tmp_path / "boat.param").write_text("ATC_STR_RAT_P,0.2\n")
    reading = "from pathlib import Path\nfrom gcs_autotune.mavlink import load_params\nload_params(Path(sys.argv[1]))"
    assert imported(reading, str(tmp_path / "boat.param")).isdisjoint(WIRE)


@pytest.mark.parametrize(
    "command", ["", "tune", "params", "logs", "restore", "experiment", "fly", "recheck", "serve", "study"]
)
def test_help_imports_no_numerics(command: str) -> None:
    asking = (
        "from gcs_autotune.cli import main\ntry:\n    main([*sys.argv[1:], '--help'])\nexcept SystemExit:\n    pass"
    )
    assert imported(asking, *command.split()).isdisjoint(NUMERICS)


def test_nothing_imports_opencv_before_an_image_is_read() -> None:
    asking = "import gcs_autotune.vision\nfrom gcs_autotune.cli import main\nassert main(['laser', 'no.mp4']) == 6"
    assert imported(asking).isdisjoint(("cv2",))


def test_nothing_imports_dask_before_a_study_runs() -> None:
    asking = (
        "import gcs_autotune.study\nfrom gcs_autotune.cli import main\nassert main(['study', 'run', 'no.toml']) == 6"
    )
    assert imported(asking).isdisjoint(("dask", "distributed", "pyarrow", "pandas"))


@pytest.mark.parametrize("wrong", [("--known", "m=abc"), ("--known", "m"), ("--option", "bounds")])
def test_an_invalid_constant_is_rejected_before_slow_imports(wrong: tuple[str, str]) -> None:
    asking = "from gcs_autotune.cli import main\nassert main(['identify', 'run.csv', *sys.argv[1:]]) == 2"
    assert imported(asking, *wrong).isdisjoint((*NUMERICS, "gcs_autotune.identify", "rich"))


def test_the_table_of_manoeuvres_is_shown_without_flight_or_fit_modules() -> None:
    modules = imported("from gcs_autotune.cli import main\nassert main(['fly', '--list']) == 0")
    assert modules.isdisjoint(("scipy", "numba", "gcs_autotune.identify", "gcs_autotune.link", "gcs_autotune.workflow"))


@pytest.mark.parametrize("command", ["fly", "diagnose", "tune"])
def test_a_command_imports_no_other_command(command: str) -> None:
    asking = "from gcs_autotune.cli import main\ntry:\n    main([sys.argv[1], '--help'])\nexcept SystemExit:\n    pass"
    commands = {name.split(".")[-1] for name in imported(asking, command) if name.endswith("_cmd")}
    assert commands == {f"{command}_cmd", "tune_cmd"}  # the exit codes of a tune are part of every help


def test_the_notebook_interface_imports_heavy_modules_only_on_use() -> None:
    modules = imported("import gcs_autotune.api")
    assert modules.isdisjoint({"scipy", "numba", "matplotlib", "rich", "gcs_autotune.identify", "gcs_autotune.report"})
