from __future__ import annotations

import math

import pytest

from sitl.actuators import FRAMES, RudderBoat, ThrusterFrame, YawSchedule
from sitl.plants import AxisDynamics, PlanarHull, Water, Wrench

SCHEDULE = YawSchedule(((16.0, 10.0, 3.0), (36.0, 8.0, 2.0), (64.0, 9.0, 2.5)))
BOAT = RudderBoat(SCHEDULE, math.radians(30), 8.0, 75.0, 0.0, 1, 3)


def _body() -> PlanarHull:
    return PlanarHull(
        AxisDynamics(1.0, 0.0, 0.0), AxisDynamics(1.0, 0.0, 0.0), AxisDynamics(1.0, 0.0, 0.0), Water(floats=True)
    )


def _drive(actuators, *pwm: int) -> tuple[Wrench, PlanarHull]:
    body, wrench = _body(), Wrench()
    actuators.drive(pwm, body.parameters, wrench)
    return wrench, body


def test_the_schedule_is_linear_between_its_rows():
    assert SCHEDULE.at(26.0) == pytest.approx((9.0, 2.5, 1.0))
    assert SCHEDULE.at(50.0) == pytest.approx((8.5, 2.25, 1.0))


def test_the_schedule_holds_its_last_row_beyond_it():
    assert SCHEDULE.at(100.0) == (9.0, 2.5, 1.0)


def test_below_the_first_row_the_rudder_fades_with_n2():
    assert SCHEDULE.at(4.0) == (10.0, 3.0, 0.25)


def test_full_rudder_is_thirty_degrees():
    wrench, body = _drive(BOAT, 2000, 0, 2000)
    assert pytest.approx(math.radians(30)) == wrench.N
    assert (body.parameters["yaw.alpha"], body.parameters["yaw.beta"]) == (9.0, 2.5)


def test_the_rudder_has_no_effect_without_flow():
    wrench, _ = _drive(BOAT, 2000, 0, 1500)
    assert wrench.N == 0.0


def test_the_rudder_acts_in_reverse_when_going_astern():
    ahead, _ = _drive(BOAT, 1800, 0, 2000)
    astern, _ = _drive(BOAT, 1800, 0, 1000)
    assert pytest.approx(-ahead.N) == astern.N
    assert pytest.approx(-75.0) == astern.X


def test_thrust_is_proportional_to_the_square_of_the_throttle():
    wrench, _ = _drive(BOAT, 1500, 0, 1750)
    assert pytest.approx(75.0 / 4) == wrench.X


def test_no_pulse_gives_no_force():
    wrench, _ = _drive(BOAT, 0, 0, 0)
    assert (wrench.X, wrench.N) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("frame", "pwm", "expected"),
    [
        ("simple-rov-3", (1100, 1900, 1500), (0.0, 1.0, 0.0)),
        ("simple-rov-3", (1900, 1900, 1500), (1.0, 0.0, 0.0)),
        ("simple-rov-3", (1500, 1500, 1900), (0.0, 0.0, 1.0)),
        ("vectored", (1900, 1100, 1100, 1900, 1500, 1500), (0.0, 1.0, 0.0)),
        ("vectored", (1100, 1100, 1900, 1900, 1500, 1500), (1.0, 0.0, 0.0)),
        ("vectored", (1500, 1500, 1500, 1500, 1700, 1700), (0.0, 0.0, 0.5)),
        ("vectored", (1900, 1100, 1900, 1100, 1500, 1500), (0.0, 0.0, 0.0)),
        ("vectored", (1900, 1100, 1100, 1900, 1500, 1500), (0.0, 1.0, 0.0, 0.0)),
        ("vectored", (1900, 1100, 1900, 1100, 1500, 1500), (0.0, 0.0, 0.0, 1.0)),
        ("simple-rov-5", (1100, 1900, 1500, 1500, 1900), (0.0, 1.0, 0.0, 1.0)),
        ("vectored-6dof-90", (1500, 1900, 1500, 1500, 1500, 1500, 1900, 1500), (1.0, 0.0, 0.0, 0.0)),
        ("vectored-6dof-90", (1100, 1900, 1100, 1900, 1900, 1100, 1100, 1100), (0.0, 1.0, 1.0, 1.0)),
    ],
)
def test_a_frame_turns_pulses_into_forces(frame, pwm, expected):
    X, N, Z, *sideways = expected
    wrench, _ = _drive(ThrusterFrame(FRAMES[frame], 2.0, 3.0, 4.0, 0.0, 0.0, full_Y=5.0 * bool(sideways)), *pwm)
    assert pytest.approx((3.0 * X, 2.0 * N, 4.0 * Z)) == (wrench.X, wrench.N, wrench.Z)
    assert pytest.approx(5.0 * sum(sideways)) == wrench.Y


def test_opposed_lateral_thrusters_turn_the_craft():
    """Miskovic2010, table 2.2 (d): they sit fore and aft, as far from the middle as the other two."""
    frame = ThrusterFrame(FRAMES["vectored-6dof-90"], 2.0, 3.0, 4.0, 0.0, 0.0, full_Y=5.0)
    alike, opposed = (_drive(frame, 1500, 1500, 1500, 1900, other)[0] for other in (1900, 1100))
    assert (alike.Y, alike.N) == (pytest.approx(5.0), 0.0)
    assert (opposed.Y, opposed.N) == (0.0, pytest.approx(2.0))


def test_opposed_fore_and_aft_lift_thrusters_pitch_the_craft():
    """Miskovic2010, table 2.2 (e)."""
    frame = ThrusterFrame(FRAMES["rov-4-fore-aft"], 2.0, 3.0, 4.0, 0.0, 0.0, full_M=6.0)
    alike, opposed = (_drive(frame, 1500, 1500, 1900, other)[0] for other in (1900, 1100))
    assert (alike.Z, alike.M) == (pytest.approx(4.0), 0.0)
    assert (opposed.Z, opposed.M) == (0.0, pytest.approx(-6.0))
    pulses = frame.write([1500] * 4, {"N": 0.0, "X": 0.0, "Z": 0.2, "M": 0.3})
    assert frame.read(pulses) == pytest.approx({"N": 0.0, "X": 0.0, "Z": 0.2, "M": 0.3}, abs=0.003)


def test_a_frame_has_its_biases_without_pulses():
    wrench, _ = _drive(ThrusterFrame(FRAMES["vectored"], 1.0, 1.0, 1.0, 0.1, -0.3), *[0] * 6)
    assert (wrench.N, wrench.Z) == (0.1, -0.3)
