"""Ctrl-C at every announced stage, lost power in mid-proof: another station sees the vehicle in its original state."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from conftest import started, warm
from firmware_process import KINDS
from tuning import ENVIRONMENT, QUICK, assert_left_alone, command_line, gains_of, summary_of, tune_until

from gcs_autotune.errors import OperatorStopped
from gcs_autotune.firmware import FIRMWARE

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(600)]

STAGES = (
    "vehicle:",
    "will arm",
    "State before the run: mode",
    "step with present gains",
    "turning around",
    "first self-oscillation",
    "second self-oscillation",
    "identifying",
    "designing",
    "predicted",
    "writing",
    "new gains written and verified by reading back",
    "step with new gains",
)
"""The start of each stage's announcement; an ROV does not turn around."""

SLUGGISH = {
    "rover": {"ATC_STR_RAT_FF": 0.2, "ATC_STR_RAT_P": 0.05, "ATC_STR_ANG_P": 1.0},
    "sub": {"ATC_RAT_YAW_P": 0.05, "ATC_ANG_YAW_P": 2.0},
}
"""Gains so far off that better ones are surely found, predicted, written and flown. ArduPilot's simulator comes with
good ones: there a tune may rightly end with "unchanged", and its later stages never come."""

ROVER_GAINS = gains_of(FIRMWARE["ardurover"].axes["heading"])
SUB_GAINS = gains_of(FIRMWARE["ardusub"].axes["heading"])


@pytest.fixture(autouse=True)
def detuned(request):
    """The module's vehicle with sluggish gains, and afterwards with its own again."""
    if "witness" not in request.fixturenames:
        yield
        return
    kind = "rover" if "rover" in request.fixturenames else "sub"
    witness = request.getfixturevalue("witness")
    own = witness.parameters(list(SLUGGISH[kind]))
    detune(witness, kind)
    yield
    for name, value in own.items():
        witness.set_parameter(name, value)


def detune(witness, kind):
    for name, value in SLUGGISH[kind].items():
        witness.set_parameter(name, value)


@pytest.mark.parametrize("stage", [s for s in STAGES if s != "turning around"])
def test_a_boat_is_unchanged_whenever_the_tune_is_stopped(rover, witness, tmp_path, stage):
    before = witness.parameters(ROVER_GAINS)
    with pytest.raises(OperatorStopped):
        tune_until(rover, "heading", stage, tmp_path / "run", stop_rule="settled")
    assert_left_alone(witness, before, KINDS["rover"].manual)
    assert summary_of(tmp_path / "run")["ending"] == "aborted"


@pytest.mark.parametrize("stage", [s for s in STAGES if s != "turning around"])
def test_an_rov_is_unchanged_whenever_the_tune_is_stopped(sub, witness, tmp_path, stage):
    before = witness.parameters(SUB_GAINS)
    with pytest.raises(OperatorStopped):
        tune_until(sub, "heading", stage, tmp_path / "run", stop_rule="settled")
    assert_left_alone(witness, before, KINDS["sub"].manual)
    assert summary_of(tmp_path / "run")["ending"] == "aborted"


def interrupted_in_mid_proof(firmware, run, blow):
    """Start a tune and call *blow* with its process when the new gains are being flown; return its exit code."""
    command = [sys.executable, "-m", "gcs_autotune", "tune", "heading", "--connect", firmware.uri, "--yes"]
    with subprocess.Popen(
        [*command, "--out", str(run), *QUICK], stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as process:
        assert process.stderr is not None
        heard = []
        for line in process.stderr:
            heard.append(line)
            if line.startswith("step with new gains"):
                blow(process)
                break
        else:
            pytest.fail("the proof was never reached:\n" + "".join(heard))
        process.stderr.read()
    return process.returncode


def test_ctrl_c_on_the_command_line_restores_the_old_gains(rover, witness, tmp_path):
    before = witness.parameters(ROVER_GAINS)
    code = interrupted_in_mid_proof(rover, tmp_path / "run", lambda process: process.send_signal(signal.SIGINT))
    assert code == 130
    assert_left_alone(witness, before, KINDS["rover"].manual)


def test_restore_restores_the_old_gains_after_the_autopilot_lost_power_in_mid_proof(tmp_path):
    run = tmp_path / "run"
    with started(KINDS["rover"]) as firmware:
        warm(firmware)
        witness = firmware.witness()
        detune(witness, "rover")
        before = witness.parameters(ROVER_GAINS)
        witness.close()
        code = interrupted_in_mid_proof(firmware, run, lambda _: firmware.kill())
        assert code not in (0, 8)
        firmware.start(wipe=False)
        witness = firmware.witness()
        left = witness.parameters(ROVER_GAINS)
        assert left != before, "ArduPilot saves what is written at once: the new gains must have survived"
        restored = command_line("restore", str(run), "--connect", firmware.uri, "--yes")
        assert restored.returncode == 0, restored.stderr
        assert_left_alone(witness, before, KINDS["rover"].manual)
        again = command_line("restore", str(run), "--connect", firmware.uri, "--yes")
        assert "nothing to restore" in again.stdout
        witness.close()


def test_restore_restores_the_old_gains_after_the_tool_was_interrupted_in_mid_proof(rover, witness, tmp_path):
    run = tmp_path / "run"
    before = witness.parameters(ROVER_GAINS)
    interrupted_in_mid_proof(rover, run, lambda process: process.kill())
    assert witness.parameters(ROVER_GAINS) != before
    restored = command_line("restore", str(run), "--connect", rover.uri, "--yes")
    assert restored.returncode == 0, restored.stderr
    assert_left_alone(witness, before, KINDS["rover"].manual)
