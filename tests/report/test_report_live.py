"""The progress line while the vehicle moves."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from gcs_autotune.clock import ManualClock
from gcs_autotune.observer import Intention, Intentions, Progress
from gcs_autotune.report import TerminalObserver
from gcs_autotune.report.toolkit.live import describe_progress

SWINGING = Progress(
    stage="first self-oscillation",
    manoeuvre="relay",
    t=42.3,
    signal="psi",
    value=math.radians(383.4),
    target=math.radians(360.0),
    output=-0.3,
    amplitude=math.radians(24.1),
    periods=3,
    periods_needed=5,
    scatter=0.07,
    guard="heading excursion",
    guard_share=0.45,
    age=0.02,
)


def _observer(*, terminal: bool, width: int = 80) -> tuple[TerminalObserver, io.StringIO, ManualClock]:
    out, clock = io.StringIO(), ManualClock()
    console = Console(
        file=out, force_terminal=terminal, width=width, color_system=None, legacy_windows=False, _environ={}
    )
    return TerminalObserver(console, clock), out, clock


def test_the_line_shows_everything_when_there_is_space():
    assert describe_progress(SWINGING) == (
        "relay 42.3 s  heading 023.4° (target 000.0°)  output -30 %  amplitude 24.1°  periods 3/5  scatter 7 %  "
        "heading excursion limit 45 % used"
    )


def test_roll_and_pitch_are_angles_and_not_rates():
    angle = math.radians(-20.0)
    assert "pitch -20.0° " in describe_progress(replace(SWINGING, signal="theta", value=angle, target=math.nan))
    assert "roll 1.0° (target -20.0°) " in describe_progress(
        replace(SWINGING, signal="phi", value=math.radians(1.0), target=angle)
    )
    assert "turn rate -20.0°/s " in describe_progress(replace(SWINGING, signal="r", value=angle, target=math.nan))


def test_a_heading_just_below_360_degrees_is_shown_as_north():
    assert "heading 000.0° " in describe_progress(replace(SWINGING, value=math.radians(-0.04)))


def test_a_narrow_line_drops_the_least_important_items():
    line = describe_progress(SWINGING, 79)
    assert len(line) <= 79
    assert "periods 3/5" in line
    assert "scatter" not in line


def test_a_silent_link_is_shown_even_on_a_narrow_line():
    line = describe_progress(replace(SWINGING, age=2.4), 45)
    assert "NO MESSAGES FOR 2.4 s" in line


@given(st.integers(1, 200))
def test_the_line_is_never_wider_than_its_limit(width):
    assert len(describe_progress(SWINGING, width)) <= width


def test_a_manoeuvre_without_any_number_still_gives_a_line():
    assert describe_progress(Progress("settling", "", 1.0)) == "settling 1.0 s"


def test_a_value_that_is_not_known_is_shown_as_unknown():
    assert "depth ? (target 1.00 m)" in describe_progress(Progress("", "step", 1.0, "z", math.nan, 1.0))


def test_in_a_pipe_a_plain_line_comes_every_five_seconds_of_vehicle_time():
    observer, out, _ = _observer(terminal=False)
    for i in range(121):
        observer.update(replace(SWINGING, t=0.1 * i))
    lines = out.getvalue().splitlines()
    assert [line.split("  ")[0] for line in lines] == ["relay 0.00 s", "relay 5.0 s", "relay 10.0 s"]
    assert "\x1b" not in out.getvalue()
    assert "\r" not in out.getvalue()


def test_in_a_pipe_a_new_manoeuvre_is_shown_at_once():
    observer, out, _ = _observer(terminal=False)
    observer.update(SWINGING)
    observer.update(replace(SWINGING, manoeuvre="step", t=42.4))
    assert len(out.getvalue().splitlines()) == 2


def test_a_restarted_vehicle_clock_does_not_silence_the_log():
    observer, out, _ = _observer(terminal=False)
    observer.update(SWINGING)
    observer.update(replace(SWINGING, t=1.0))
    assert len(out.getvalue().splitlines()) == 2


def test_in_a_terminal_one_line_is_rewritten_at_most_ten_times_a_second():
    observer, out, clock = _observer(terminal=True)
    for i in range(1000):
        clock.advance_to(0.001 * i)
        observer.update(replace(SWINGING, t=0.1 * i))
    assert 9 <= out.getvalue().count("relay ") <= 11
    assert "\n" not in out.getvalue()
    assert all(len(piece) <= 80 for piece in out.getvalue().replace("\x1b[2K", "").split("\r"))


def test_a_message_replaces_the_progress_line_and_ends_with_a_newline():
    observer, out, _ = _observer(terminal=True)
    observer.update(SWINGING)
    observer.say("written and read back [not markup]")
    assert out.getvalue().endswith("\r\x1b[2Kwritten and read back [not markup]\n")


def test_closing_ends_the_line_once_and_the_cursor_stays_visible():
    observer, out, _ = _observer(terminal=True)
    with observer:
        observer.update(SWINGING)
    observer.close()
    assert out.getvalue().count("\n") == 1
    assert "\x1b[?25l" not in out.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_a_message_before_any_progress_is_a_plain_line(terminal):
    observer, out, _ = _observer(terminal=terminal)
    observer.say("link: sitl:videoray")
    assert out.getvalue() == "link: sitl:videoray\n"


def test_a_job_step_announces_only_what_is_new():
    style, space = Intention("design for style quick", "Style", "quick"), Intention("need 2 m", "Space", "2 m")
    again = Intention("continue if messages stop")
    usual = Intention("design for style normal", is_usual=True)
    observer, out, _ = _observer(terminal=True)
    for writes in ("gains of two loops", "some of ATC_ANG_YAW_P", "some of PSC_POSZ_P"):
        step = Intentions((style, space, again, usual, Intention(f"write {writes}", "Writes", writes)))
        observer.say("link: sitl:bluerov2")
        observer.note(step)
        for text in step.texts:
            observer.say(f"will {text}")
    shown = out.getvalue()
    for once in ("link: sitl:bluerov2", "Style", "Space", "will continue if messages stop"):
        assert shown.count(once) == 1
    assert shown.count("Writes") == 3
    assert "will write" not in shown
    assert "style normal" not in shown


def test_a_command_to_copy_stays_on_one_line():
    observer, out, _ = _observer(terminal=False, width=60)
    command = "gcs-autotune tune heading --connect /dev/ttyUSB0,57600 --resume runs/20261127-boat-heading"
    observer.say(f"these records can be used again: step-before. To continue, use the same options: {command}")
    assert f"  {command}" in out.getvalue().splitlines()
    assert max(map(len, out.getvalue().splitlines()[:-1])) <= 60
