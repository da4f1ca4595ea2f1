"""Relays on the set-point: where they switch, what is commanded meanwhile, when each is over."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.axes import AXES
from gcs_autotune.craft import DepthTarget, HeadingTarget, Observation
from gcs_autotune.errors import UsageError
from gcs_autotune.manoeuvres.set_point_relay import KIND, LONGEST, PATIENCE, SetPointRelay

from .toy_craft import answered, at_rest

C, X_A = 0.2, 0.05
RELAYS = ((C, X_A), (0.5 * C, X_A))
BEGUN = 3.5
"""Half a second, which is one command here, after the noise of the signal is known."""
AXIS_OF = {"psi": "heading", "z": "depth", "u": "speed"}
BASE = {"psi": 1.0, "z": 4.0, "u": 0.8}
"""The centre of oscillation: the course, the present depth, the cruise of 1 m/s less the larger relay."""


def relay(signal: str = "psi", relays: tuple[tuple[float, float], ...] = RELAYS, **changes: float) -> SetPointRelay:
    speed = {"psi": 0.0, "z": 0.0, "u": 1.0}[signal]
    return SetPointRelay(relays, changes.get("speed", speed), axis=AXES[AXIS_OF[signal]])


def oscillate(manoeuvre: SetPointRelay, base: float) -> list:
    """A loop that moves 0.03 per tick towards the last commanded side: it oscillates by 0.09 about *base*."""
    away, commanded = [0.0], [0.0, 0.0]

    def seen(t: float, command: object) -> Observation:
        target = getattr(command, {"psi": "psi", "z": "z", "u": "speed"}[manoeuvre.signal], base)
        commanded.append(round(target - base, 9))
        if t > BEGUN:
            away.append(away[-1] + math.copysign(0.03, commanded[-2]))
        now = {"psi": 1.0, "z": 4.0, "u": BASE["u"], "speed": 1.0}
        return at_rest(t=t, **({**now, manoeuvre.signal: base + away[-1]} if t > BEGUN else now))

    return answered(manoeuvre, seen)


@pytest.mark.parametrize("signal", ["psi", "z", "u"])
def test_each_relay_commands_its_amplitude_about_the_reference_until_it_settles(signal: str) -> None:
    base, manoeuvre = BASE[signal], relay(signal)
    rows = oscillate(manoeuvre, base)
    marks = manoeuvre.take_marks()
    begun = [m for m in marks if m.kind == "relay"]
    at = list(marks).index(begun[1])
    parts = [[m.detail[f"{signal}_ref"] for m in part if m.kind == "switch"] for part in (marks[:at], marks[at:])]
    assert [m.detail for m in begun] == [{"C": C, "x_a": X_A}, {"C": 0.5 * C, "x_a": X_A}]
    assert begun[0].t == BEGUN
    # the first command, one switching that begins the first of five periods, and ten that end their halves
    assert parts[0] == pytest.approx([base + C * (-1.0) ** k for k in range(12)])
    assert parts[1][:2] == pytest.approx([base + 0.5 * C, base - 0.5 * C])
    assert manoeuvre.outcome is not None
    about = "course" if signal == "psi" else AXIS_OF[signal]
    assert manoeuvre.outcome.ending == "completed"
    assert manoeuvre.outcome.reason == f"2 relays about the {about} settled"
    made = {
        "psi": HeadingTarget(base, 0.0), "z": DepthTarget(base), "u": HeadingTarget(1.0, pytest.approx(base))
    }[signal]  # fmt: skip
    assert rows[-1][1] == rows[0][1] == made
    assert (manoeuvre.phase, manoeuvre.target) == ("relay 2", pytest.approx(base))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("share", "switches"), [(0.98, False), (1.0, True), (1.02, True)])
def test_a_relay_switches_beyond_the_hysteresis_on_either_side_of_the_course(
    side: float, share: float, switches: bool
) -> None:
    manoeuvre = relay(relays=((C, X_A),))

    def seen(t: float, command: object) -> Observation:
        if t <= BEGUN:
            return at_rest(t=t)
        through = 0.0 if side > 0.0 else X_A * 1.1 * (t < 4.5)
        return at_rest(t=t, psi=through + side * share * X_A * (t >= 5.0))

    rows = answered(manoeuvre, seen)
    at = {row.t: command.psi for row, command in rows}
    before = C if side > 0.0 else -C
    assert at[4.5] == before
    assert at[5.0] == (-before if switches else before)
    assert manoeuvre.outcome is not None
    assert manoeuvre.outcome.ending == "aborted"
    last = 5.0 if switches else (BEGUN if side > 0.0 else 4.0)
    assert rows[-1][0].t == last + PATIENCE + 0.5
    assert "with 11.4592 deg commanded to one side, the heading did not cross 2.86479 deg within 60 s" in (
        manoeuvre.outcome.reason
    )


def test_an_unsettled_relay_ends_after_a_number_of_periods_or_a_time_limit() -> None:
    quick = relay(relays=((C, X_A),))

    def growing(period: float):
        def seen(t: float, command: object) -> Observation:
            k = math.floor((t - BEGUN) / (0.5 * period))  # every half has another amplitude
            return at_rest(t=t, psi=(0.06 + 0.05 * (k % 3)) * (-1.0) ** (k + 1) if t > BEGUN else 0.0)

        return seen

    rows = answered(quick, growing(3.0))
    assert quick.outcome is not None
    assert quick.outcome.reason.endswith("1 did not settle: the loop is poorly damped, or waves disturb it")
    assert len([m for m in quick.take_marks() if m.kind == "switch"]) == 31
    slow = relay(relays=((C, X_A),))
    rows = answered(slow, growing(30.0))
    assert rows[-1][0].t == BEGUN + LONGEST + 0.5
    assert slow.outcome is not None
    assert "1 did not settle" in slow.outcome.reason


def test_a_relay_with_only_five_switches_at_the_time_limit_continues() -> None:
    manoeuvre = relay(relays=((C, X_A),))

    def seen(t: float, command: object) -> Observation:
        k = math.floor((t - BEGUN) / 22.0) if t < BEGUN + 110.0 else 5 + (t >= BEGUN + 130.0)
        return at_rest(t=t, psi=0.06 * (-1.0) ** (k + 1) if t > BEGUN else 0.0)

    rows = answered(manoeuvre, seen)
    assert rows[-1][0].t == BEGUN + 130.0


def test_settings_and_results_are_recorded() -> None:
    manoeuvre = relay("u")
    oscillate(manoeuvre, BASE["u"])
    assert manoeuvre.meta_fields == {
        "dof": "surge", "signal": "u", "set_points": [C, 0.5 * C], "hystereses": [X_A, X_A], "speed": 1.0,
        "noise_std": 0.0,
    }  # fmt: skip
    assert (manoeuvre.purpose, manoeuvre.in_manual) == ("check", False)


@pytest.mark.parametrize(("C", "x_a"), [(0.2, 0.2), (0.2, 0.21), (0.2, 0.0), (0.2, -0.1)])
def test_a_relay_that_might_never_switch_is_rejected(C: float, x_a: float) -> None:
    with pytest.raises(UsageError, match="the heading may never cross"):
        relay(relays=((0.3, 0.1), (C, x_a)))


def test_without_a_speed_the_craft_stays_in_place_and_the_relay_starts_at_once() -> None:
    manoeuvre = SetPointRelay(RELAYS)
    rows = answered(manoeuvre, lambda t, command: at_rest(t=t, speed=0.1 * t), most=5.0)
    assert {command.speed for _, command in rows} == {0.0}
    assert next(m.t for m in manoeuvre.take_marks() if m.kind == "relay") == BEGUN
    under_way = relay(speed=1.0)
    rows = answered(under_way, lambda t, command: at_rest(t=t, speed=min(0.1 * t, 1.0)), most=20.0)
    assert {command.speed for _, command in rows} == {1.0}
    assert next(m.t for m in under_way.take_marks() if m.kind == "relay") > 10.0


@pytest.mark.parametrize(("speed", "refused"), [(0.4, True), (0.39, True), (0.41, False), (0.0, False)])
def test_a_speed_relay_that_reaches_zero_speed_is_rejected(speed: float, refused: bool) -> None:
    assert relay("psi", speed=speed).meta_fields["set_points"] == [C, 0.5 * C]
    if refused:
        with pytest.raises(UsageError, match=r"of 0\.2 m/s about 0\.(2|19) m/s reaches zero speed"):
            relay("u", speed=speed)
        return
    assert relay("u", speed=speed).meta_fields["set_points"] == [C, 0.5 * C]


@pytest.mark.parametrize(
    ("force", "axis", "dof"), [("N", "heading", "yaw"), ("Z", "depth", "heave"), ("X", "speed", "surge")]
)
def test_the_row_of_a_force_creates_two_relays_on_its_loop(force: str, axis: str, dof: str) -> None:
    row = KIND.of(force)
    assert (row.axis, row.excites, row.drives, row.identifies) == (axis, {dof}, frozenset(), False)
    assert row.make is not None
    sizes = {"set-point": 0.3, "hysteresis": 0.1, "second-set-point": 0.2, "second-hysteresis": 0.05}
    made = row.make({**sizes, "speed": 1.2})
    assert made.meta_fields["set_points"] == [0.3, 0.2]
    assert made.meta_fields["hystereses"] == [0.1, 0.05]
    assert made.force == force
    first = next(row.make({**sizes, "speed": 1.2}).commands(at_rest(psi=0.5, z=2.0, u=1.0)))
    assert (
        first
        == {"N": HeadingTarget(0.5, 1.2), "Z": DepthTarget(2.0), "X": HeadingTarget(0.5, pytest.approx(0.9))}[force]
    )
    assert next(row.make(sizes).commands(at_rest(psi=0.5, z=2.0))) == (
        DepthTarget(2.0) if force == "Z" else HeadingTarget(0.5, 0.0 if force == "N" else -0.3)
    )
    with pytest.raises(UsageError, match="no loop for Y"):
        row.of("Y")
