"""Our hulls behind ArduPilot's external-physics interface, without an ArduPilot."""

from __future__ import annotations

import json
import math
import socket
import struct

import pytest

from sitl import VEHICLES, BadEffect, load_vehicle
from sitl.__main__ import main
from sitl.actuators import FRAMES
from sitl.ardupilot_json import JsonServer, Physics, needed_parameters, parameter_text, start_commands
from sitl.ardupilot_json.wire import BadPacket, State, read_servos, write_state
from sitl.effects import EFFECTS, parse_effect
from tests.sitl.ground import refusal_of

NEUTRAL = [1500] * 16
NUMBERS = {
    "time-scale": "factor=1.01",
    "shallow-water": "draught=0.2,depth=2",
    "unit-error": "factor=2",
    "saturation": "limit=0.5",
    "dead-zone": "width=0.1",
    "quadratic-actuator": "share=0.5",
    "rudder-stall": "angle=0.5,drop=0.5",
    "asymmetric-thrust": "ratio=0.7",
    "gain-drift": "rate=0.001",
    "speed-dependent-steering": "share=0.5",
    "outliers": "share=0.01,size=0.1",
    "quantisation": "step=0.1",
    "mass-change": "ratio=2,time=1",
    "ground-effect": "strength=1,length=1",
    "wave-disturbance": "amplitude=0.1,frequency=1",
    "wind-moment": "strength=0.1,direction=1",
    "tether-pull": "stiffness=0.1",
}
IN_THE_RECORD = {"time-scale", "time-offset", "unit-error", "sign-error", "channel-swap"}


def pulses(**given: int) -> list[int]:
    made = list(NEUTRAL)
    for name, pulse in given.items():
        made[int(name.removeprefix("s")) - 1] = pulse
    return made


def fly(physics: Physics, pwm: list[int], seconds: float, rate: int = 200) -> list[State]:
    reported = []
    for _ in range(round(seconds * rate)):
        state = physics.step(1.0 / rate, pwm)
        reported.append(State(state.t, state.gyro, state.force, state.attitude, state.position, state.velocity))
    return reported


def request(count: int, pwm: list[int], rate: int = 200) -> bytes:
    return struct.pack("<HHI16H", 18458, rate, count, *pwm)


# -- the format


def test_sixteen_and_thirty_two_pulses_are_read_the_same_way():
    few = read_servos(struct.pack("<HHI16H", 18458, 400, 7, *range(16)))
    many = read_servos(struct.pack("<HHI32H", 29569, 400, 7, *range(32)))
    assert few == many
    assert (few.rate, few.count, few.pwm) == (400, 7, tuple(range(16)))


@pytest.mark.parametrize("datagram", [b"", b"\x01", b"\xfe" * 40, request(1, NEUTRAL)[:-1], request(1, NEUTRAL) + b"!"])
def test_other_datagrams_are_rejected(datagram):
    with pytest.raises(BadPacket):
        read_servos(datagram)


def test_the_reply_is_one_line_of_json_without_white_space():
    sent = write_state(
        State(1.25, (0.1, 0.2, 0.3), (1.0, 2.0, -9.8), (0.0, 0.0, 3.1), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    )
    assert sent.startswith(b"\n{")
    assert sent.endswith(b"}\n")
    assert not set(sent[1:-1]) & set(b" \t\n")
    document = json.loads(sent)
    assert document["timestamp"] == 1.25
    assert document["imu"] == {"gyro": [0.1, 0.2, 0.3], "accel_body": [1.0, 2.0, -9.8]}
    assert document["attitude"] == [0.0, 0.0, 3.1]
    assert document["position"] == [1.0, 2.0, 3.0]
    assert document["velocity"] == [4.0, 5.0, 6.0]


# -- the hull


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_rests_level_at_home(name):
    first = fly(Physics(load_vehicle(name)), NEUTRAL, 0.005)[0]
    assert first.position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert first.force == pytest.approx((0.0, 0.0, -9.80665), abs=0.2)
    assert first.attitude[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "pwm", "turns", "ahead"),
    [
        ("charlie", pulses(s1=1700, s3=1800), 1, 1),
        ("charlie", pulses(s1=1300, s3=1800), -1, 1),
        ("blueboat", pulses(s1=1700, s3=1500), 1, 1),
        ("blueboat", pulses(s1=1500, s3=1700), -1, 1),
        ("falcon", pulses(s1=1700, s2=1300, s3=1300, s4=1700), 1, 0),
        ("bluerov2", pulses(s1=1300, s2=1700, s3=1700, s4=1300), -1, 0),
        ("bluerov2", pulses(s1=1300, s2=1300, s3=1700, s4=1700), 0, 1),
        ("videoray", pulses(s1=1400, s2=1600), 1, 0),
    ],
)
def test_servo_pulses_move_each_frame_as_in_its_firmware(name, pwm, turns, ahead):
    physics = Physics(load_vehicle(name))
    end = fly(physics, pwm, 4.0)[-1]
    speed = end.velocity[0] * math.cos(end.attitude[2]) + end.velocity[1] * math.sin(end.attitude[2])
    assert (end.gyro[2] * turns > 0.05) if turns else abs(end.gyro[2]) < 0.3
    assert (speed > 0.05) if ahead else abs(speed) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("name", "vertical"), [("bluerov2", (5, 6, 7, 8)), ("falcon", (5, 6)), ("videoray", (3,))])
def test_an_rov_dives_surfaces_and_stays_in_the_water(name, vertical):
    physics = Physics(load_vehicle(name))
    down = fly(physics, pulses(**{f"s{n}": 1700 for n in vertical}), 3.0)[-1]
    assert down.position[2] > 0.3
    assert down.velocity[2] > 0.0
    bottom = fly(physics, pulses(**{f"s{n}": 1900 for n in vertical}), 90.0, 100)[-1]
    assert 10.0 <= bottom.position[2] < 12.0
    surface = fly(physics, pulses(**{f"s{n}": 1100 for n in vertical}), 90.0, 100)[-1]
    assert -2.0 < surface.position[2] <= 0.0


def test_the_accelerometer_agrees_with_the_velocity():
    reported = fly(Physics(load_vehicle("charlie")), pulses(s1=1800, s3=1900), 20.0)
    vN = vE = 0.0
    for state in reported:
        psi = state.attitude[2]
        ax, ay, az = state.force
        vN += (ax * math.cos(psi) - ay * math.sin(psi)) / 200
        vE += (ax * math.sin(psi) + ay * math.cos(psi)) / 200
        assert az == -9.80665
    assert (vN, vE) == pytest.approx(reported[-1].velocity[:2], abs=2e-3)


def test_the_gyro_agrees_with_the_heading():
    physics = Physics(load_vehicle("bluerov2"))
    start = physics.state.attitude[2]
    reported = fly(physics, pulses(s1=1600, s2=1400, s3=1400, s4=1600), 5.0)
    turned = sum(state.gyro[2] for state in reported) / 200
    assert math.remainder(start + turned - reported[-1].attitude[2], math.tau) == pytest.approx(0.0, abs=5e-3)


def test_the_motion_does_not_depend_on_the_frame_rate():
    ends = [fly(Physics(load_vehicle("charlie")), pulses(s1=1800, s3=1900), 10.0, rate)[-1] for rate in (20, 400)]
    assert ends[0].position == pytest.approx(ends[1].position, abs=1e-3)
    assert ends[0].attitude == pytest.approx(ends[1].attitude, abs=1e-5)


# -- hidden effects


@pytest.mark.parametrize("slug", EFFECTS)
def test_every_effect_of_the_catalogue_reaches_ardupilot_or_is_rejected(slug):
    text = slug
    if slug == "channel-swap":
        text += "@x+y"
    if slug in ("unit-error", "sign-error"):
        text += "@psi"
    if EFFECTS[slug].parameters:
        default = ",".join(f"{p.name}=0.2" for p in EFFECTS[slug].parameters if p.default is None)
        text += "." + (NUMBERS.get(slug) or default or f"{EFFECTS[slug].parameters[0].name}=0.2")
    effect = parse_effect(text)
    if slug in IN_THE_RECORD:
        with pytest.raises(BadEffect, match="which ArduPilot itself writes"):
            Physics(load_vehicle("bluerov2"), effects=[effect])
        return
    if EFFECTS[slug].on_vehicles.startswith("no"):
        with pytest.raises(BadEffect, match="sway"):
            Physics(load_vehicle("bluerov2"), effects=[effect])
        return
    states = fly(Physics(load_vehicle("bluerov2"), effects=[effect]), pulses(s1=1600, s4=1600), 0.5)
    assert len(states) == 100
    reported = [x for s in states for x in (*s.gyro, *s.force, *s.attitude, *s.position, *s.velocity)]
    assert all(map(math.isfinite, reported))


def test_a_compass_deviation_changes_only_the_heading():
    plain, iron = (
        fly(Physics(load_vehicle("charlie"), effects=effects), pulses(s1=1700, s3=1900), 8.0)[-1]
        for effects in ([], [parse_effect("compass-deviation.B=0.1,C=-0.05")])
    )
    psi = plain.attitude[2]
    assert iron.attitude[2] - psi == pytest.approx(0.1 * math.sin(psi) - 0.05 * math.cos(psi), abs=1e-9)
    assert iron.gyro == plain.gyro
    assert iron.velocity == pytest.approx(plain.velocity, abs=1e-12)
    assert iron.force == plain.force


def test_a_current_carries_the_hull_over_the_ground():
    drifting = fly(Physics(load_vehicle("charlie"), effects=[parse_effect("steady-current.V_x=0.3")]), NEUTRAL, 2.0)[-1]
    assert drifting.velocity[0] == pytest.approx(0.3)
    assert drifting.position[0] == pytest.approx(0.6, abs=1e-6)


@pytest.mark.parametrize("text", ["quantisation@phi.step=0.1", "steady-current@through water.V_x=0.3"])
def test_effects_that_ardupilot_cannot_receive_are_rejected(text):
    with pytest.raises(BadEffect, match=r"level|over ground"):
        Physics(load_vehicle("charlie"), effects=[parse_effect(text)])


# -- the loop


@pytest.fixture
def served():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        reported: list[str] = []
        autopilot.bind(("127.0.0.1", 0))
        autopilot.settimeout(0.2)
        server = JsonServer(Physics(load_vehicle("charlie")), port=0, say=reported.append)

        def ask(datagram: bytes, ear: socket.socket = autopilot) -> dict | None:
            ear.sendto(datagram, ("127.0.0.1", server.port))
            server.serve_one()
            try:
                return json.loads(ear.recv(2048))
            except TimeoutError:
                return None

        yield server, ask, reported
        server.close()


def test_every_frame_gets_a_reply_and_a_repeated_one_the_same(served):
    server, ask, _ = served
    first = ask(request(0, NEUTRAL))
    assert first is not None
    assert first["timestamp"] == pytest.approx(1 / 200)
    assert ask(request(0, NEUTRAL)) == first
    assert ask(request(1, NEUTRAL))["timestamp"] == pytest.approx(2 / 200)
    assert (server.frames, server.simulated) == (2, pytest.approx(0.01))


def test_a_restarted_autopilot_finds_a_hull_at_home(served):
    server, ask, reported = served
    for count in range(400):
        ask(request(count, pulses(s3=2000)))
    assert server.physics.state.velocity[0] > 0.1
    again = ask(request(0, NEUTRAL))
    assert again["timestamp"] == pytest.approx(1 / 200)
    assert again["position"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)
    assert len(reported) == 2


def test_a_second_autopilot_gets_a_reply_only_from_its_first_frame(served):
    server, ask, _ = served
    ask(request(5, NEUTRAL))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.settimeout(0.05)
        assert ask(request(6, NEUTRAL), other) is None
        assert ask(request(0, NEUTRAL), other) is not None
    assert server.frames == 2


def test_physics_started_during_a_run_continue_with_the_clock_of_the_autopilot(served):
    _, ask, _ = served
    assert ask(request(2000, NEUTRAL))["timestamp"] == pytest.approx(10.0 + 1 / 200)


def test_a_foreign_datagram_is_reported_once_and_gets_no_reply(served):
    server, ask, reported = served
    assert ask(b"\xfe\x09 not this interface") is None
    assert ask(b"\xfe\x09 not this interface") is None
    assert server.frames == 0
    assert len(reported) == 1
    assert "not from ArduPilot's JSON interface" in reported[0]


# -- what ArduPilot needs


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_lists_the_ardupilot_parameters_it_needs(name):
    data = load_vehicle(name)
    needed = needed_parameters(data)
    assert needed["FRAME_CLASS" if data.is_boat else "FRAME_CONFIG"] > 0
    assert data.parameters.items() <= needed.items()
    lines = parameter_text(data).splitlines()
    assert lines[0].startswith("# ")
    assert dict(line.split() for line in lines[1:]).keys() == needed.keys()
    assert "-I 3 " in start_commands(data, 9032, "x.parm")
    assert "--sim-port-out 9005 " in start_commands(data, 9005, "x.parm")


def test_a_frame_of_fewer_than_six_thrusters_has_no_simulated_battery():
    """ArduPilot's takes 45 A for each of the first six outputs that has no pulse."""
    watched = {}
    for name in VEHICLES:
        data = load_vehicle(name)
        if not data.is_boat:
            motors = FRAMES[data.tables["actuators"]]
            watched[name] = (len(motors) >= 6, needed_parameters(data)["BATT_MONITOR"] > 0)
    assert len(set(watched.values())) == 2, "both kinds are there"
    assert all(thrusters == battery for thrusters, battery in watched.values())


def test_the_parameters_are_written_for_defaults(tmp_path):
    path = tmp_path / "blueboat.parm"
    assert main(["blueboat", "--ardupilot-params", str(path)]) == 0
    assert "SERVO1_FUNCTION 73" in path.read_text().splitlines()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ardupilot-json"], "no vehicle selected. Use one of charlie"),
        (["charlie", "--ardupilot-json", "ninethousand"], "not PORT or HOST:PORT. Use e.g. 9002"),
        (["charlie", "--ardupilot-json", "--param", "WP_SPEED=1"], "For ArduPilot use"),
        (
            ["charlie", "--ardupilot-json", "0", "--effect", "time-offset.offset=0.1"],
            "which ArduPilot itself writes",
        ),
        (["charlie", "--ardupilot-params", "/nowhere/x.parm"], "No such file or directory"),
    ],
)
def test_a_wrong_command_line_under_ardupilot_is_explained_in_one_line(arguments, said, capsys):
    assert said in refusal_of(arguments, capsys)


def test_a_physics_port_in_use_is_explained_in_one_line(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        assert main(["charlie", "--ardupilot-json", str(other.getsockname()[1])]) == 3
    error = capsys.readouterr().err
    assert "the port is in use" in error
    assert error.count("\n") == 1


def test_a_body_that_tilts_sends_its_attitude_and_gravity_along_its_axes():
    physics = Physics(load_vehicle("bluerov2-6dof"))
    at = physics.craft.plant.state
    at.z, at.theta = 5.0, 0.4
    reported = physics.step(0.0025, [1500] * 16)
    assert reported.attitude[1] == pytest.approx(0.4, abs=1e-3)
    assert reported.gyro[1] == pytest.approx(at.q)
    assert reported.force[0] == pytest.approx(9.80665 * math.sin(0.4), abs=0.6)
    assert load_vehicle("bluerov2").make_plant().state.tilts is False


def test_the_distances_of_rangefinders_are_sent_and_their_drivers_selected() -> None:
    data = load_vehicle("videoray-lasers")
    physics = Physics(data)
    state = physics.step(0.01, NEUTRAL)
    document = json.loads(write_state(state))
    assert (document["rng_1"], document["rng_2"]) == pytest.approx((2.0, 2.0), abs=0.05)
    assert {name: value for name, value in needed_parameters(data).items() if name.startswith("RNGFND")} == {
        "RNGFND1_TYPE": 100,
        "RNGFND1_ORIENT": 0,
        "RNGFND2_TYPE": 100,
        "RNGFND2_ORIENT": 0,
    }
    physics.craft.plant.state.psi += math.pi
    for _ in range(100):
        state = physics.step(0.01, NEUTRAL)
    assert json.loads(write_state(state))["rng_1"] == 1000.0
    assert "rng_1" not in json.loads(write_state(Physics(load_vehicle("videoray")).state))
