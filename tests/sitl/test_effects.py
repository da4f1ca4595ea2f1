"""The interface for hidden effects: a neutral effect changes nothing, and every hook is called."""

from __future__ import annotations

from sitl import HiddenEffect
from tests.sitl.ground import boat, rov


def test_a_neutral_effect_changes_no_bit():
    plain, with_effect = boat(), boat(effects=[HiddenEffect()])
    for ground in (plain, with_effect):
        ground.sticks = {1: 1700, 3: 1800}
        ground.run(5.0)
    assert [m.get_msgbuf() for m in plain.heard] == [m.get_msgbuf() for m in with_effect.heard]


class _StuckRudder(HiddenEffect):
    def alter_command(self, t, pwm):
        pwm[0] = 1500


def test_a_command_can_be_altered_between_autopilot_and_actuator():
    ground = boat(effects=[_StuckRudder()])
    ground.sticks = {1: 2000, 3: 2000}
    ground.run(10.0)
    assert ground.servos[0] == 2000
    assert abs(ground.vehicle.state.r) < 0.01


class _Current(HiddenEffect):
    def alter_force(self, t, loads):
        loads.X += 20.0


def test_a_force_can_be_added():
    ground = boat(armed=False, effects=[_Current()])
    ground.run(10.0)
    assert ground.vehicle.state.u > 0.3


class _Payload(HiddenEffect):
    def alter_parameters(self, t, parameters):
        parameters["heave.alpha"] = 30.0


def test_the_hull_can_be_altered():
    ground = rov(effects=[_Payload()])
    assert ground.vehicle.plant.axis("heave").alpha == 30.0


class _CompassBias(HiddenEffect):
    def alter_measurement(self, t, reading):
        reading.psi += 0.5


def test_a_measurement_can_be_altered():
    ground = rov(effects=[_CompassBias()])
    ground.run(1.0)
    assert 0.4 < ground.last("ATTITUDE").yaw - ground.vehicle.state.psi < 0.6
