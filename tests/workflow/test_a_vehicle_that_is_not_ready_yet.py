"""Just booted, at the surface, cruising fast: cases met on ArduPilot's own simulator."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import pytest

from gcs_autotune.craft import DepthTarget, Observation
from gcs_autotune.errors import OperatorStopped
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.manoeuvres import Dive, DiveSettings, Envelope, Relay, RelaySettings
from gcs_autotune.workflow.context import TuneContext
from gcs_autotune.workflow.experiments import dive_for
from tests.workflow.sitl_harness import SitlHarness


class StopsWhen:
    """Presses Ctrl-C at the first announcement that begins with *beginning*."""

    def __init__(self, harness, beginning):
        self.harness, self.beginning = harness, beginning

    def stop_requested(self):
        return any(text.startswith(self.beginning) for text in self.harness.said)

    def ask(self, question, while_waiting):
        return True


@pytest.mark.slow
def test_a_boat_without_a_position_is_awaited_before_it_is_armed(tmp_path):
    harness = SitlHarness(tmp_path)
    harness.vehicle.autopilot.ready_ms = 42_000
    with pytest.raises(OperatorStopped):
        harness.tune(StopsWhen(harness, "step with present gains"))
    announced = harness.said
    waiting = next(i for i, t in enumerate(announced) if t.startswith("waiting for the vehicle"))
    assert waiting < announced.index("step with present gains")
    assert harness.server.now > 42.0
    harness.assert_as_found()


def test_only_an_rov_near_the_surface_dives_and_only_for_depth():
    shallow, deep = Observation(0.0, 0.0, z=0.05), Observation(0.0, 0.0, z=2.0)
    assert dive_for("heave", FIRMWARE["ardusub"], shallow) is not None
    assert dive_for("heave", FIRMWARE["ardusub"], deep) is None
    assert dive_for("yaw", FIRMWARE["ardusub"], shallow) is None
    assert dive_for("heave", FIRMWARE["ardurover"], shallow) is None


@pytest.mark.parametrize(
    ("depths", "flown"), [((0.3, 2.0), "dive relay-1 relay-2"), ((2.0, 0.3), "relay-1 dive relay-2")]
)
def test_an_rov_dives_before_every_manoeuvre_that_would_start_at_the_surface(depths, flown):
    names: list[str] = []

    def fly(manoeuvre, stage):
        names.append(manoeuvre.kind if isinstance(manoeuvre, Dive) else manoeuvre.name)

    seen = iter(depths)
    context = SimpleNamespace(
        axis=FIRMWARE["ardusub"].axes["depth"],
        craft=SimpleNamespace(firmware=FIRMWARE["ardusub"], observe=lambda: Observation(0.0, 0.0, z=next(seen))),
        runner=SimpleNamespace(fly=fly),
        log=SimpleNamespace(say=lambda text: None),
        earlier=SimpleNamespace(take=lambda name: None),
    )
    context.come_down = partial(TuneContext.come_down, context)
    for name in ("relay-1", "relay-2"):
        TuneContext.fly(context, Relay(RelaySettings("z", "Z"), name), name)
    assert " ".join(names) == flown


def descend(rate: float) -> Dive:
    """Fly a dive with a craft that follows at *rate* [m/s]."""
    dive, t, z = Dive(DiveSettings(1.5)), 0.0, 0.0
    commands = dive.commands(Observation(t, 0.0, z=z))
    command = next(commands)
    while dive.outcome is None:
        assert isinstance(command, DepthTarget)
        assert command.z <= 1.5
        t, z = t + 0.1, min(command.z, z + 0.1 * rate)
        command = commands.send(Observation(t, 0.0, z=z))
    return dive


def test_a_dive_ends_at_its_depth_or_reports_that_the_craft_does_not_sink():
    assert descend(0.2).outcome.ending == "completed"
    refused = descend(0.0).outcome
    assert refused.ending == "aborted"
    assert "did not reach 1.5 m" in refused.reason


def test_default_speed_and_distance_limits_grow_with_the_cruise_speed():
    assert (Envelope().speed_limit, Envelope().distance_limit) == (4.0, 300.0)
    assert (Envelope(cruise=5.0).speed_limit, Envelope(cruise=5.0).distance_limit) == (7.5, 500.0)
    assert Envelope(cruise=5.0, speed=3.0).speed_limit == 3.0
    assert Envelope(cruise=5.0, distance=80.0).distance_limit == 80.0
