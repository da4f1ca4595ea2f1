"""Compilers work before the link is opened, not while a vehicle waits, armed."""

from __future__ import annotations

import pytest

from gcs_autotune.design.laws import LAWS
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.workflow import warming


class Listener:
    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.mark.parametrize("axis", ["heading", "yaw", "depth", "speed"])
def test_every_law_of_an_axis_is_compiled_before_a_link_is_opened(axis):
    axes = [f.axes[axis] for f in FIRMWARE.values() if axis in f.axes]
    warming.warm_up("/dev/ttyUSB0,57600", (a.dof for a in axes), (a.law for a in axes), Listener())
    assert all(LAWS[a.law].kernel.signatures for a in axes)


def test_time_that_stands_still_needs_no_warming(monkeypatch):
    def never(dof: str) -> None:
        raise AssertionError(dof)

    monkeypatch.setattr(warming, "_identify", never)
    warming.warm_up("sitl:charlie", ["yaw"], ["rover_heading"], Listener())


def test_a_long_compilation_is_told_of(monkeypatch):
    monkeypatch.setattr(warming, "_PATIENCE", 0.0)
    listener = Listener()
    warming.warm_up("udpin:0.0.0.0:14550", ["yaw"], [], listener)
    assert "first time after installation" in listener.said[0]
