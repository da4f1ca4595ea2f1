"""Compilers work before anything is armed, in the process that will compute, not while a vehicle waits."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from numba import config

from gcs_autotune.clock import WallClock
from gcs_autotune.design.laws.kernel import fly
from gcs_autotune.design.margins import _read_off
from gcs_autotune.design.step_metrics import _read_step
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.observer import SilentObserver
from gcs_autotune.workflow import jit_warmup


class Listener(SilentObserver):
    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="there is nothing to compile")
@pytest.mark.parametrize("axis", ["heading", "yaw", "depth", "speed"])
def test_the_laws_of_an_axis_are_compiled(axis):
    axes = [f.axes[axis] for f in FIRMWARE.values() if axis in f.axes]
    assert axes
    jit_warmup.warm_up(sorted({a.dof for a in axes}), sorted({a.law for a in axes}))
    assert fly.signatures and _read_off.signatures and _read_step.signatures


@pytest.mark.parametrize("connection", ["sitl:charlie", "memory"])
def test_simulated_time_needs_no_process_and_no_warm_up(connection):
    listener = Listener()
    with jit_warmup.jit_warmup(connection, ["yaw"], ["rover-heading"]) as worker:
        jit_warmup.await_warmup(None, worker, listener)
        assert not worker.apart
    assert listener.said == []


@pytest.mark.slow
def test_a_long_compilation_is_announced_once_while_the_craft_is_monitored(monkeypatch):
    monkeypatch.setattr(jit_warmup, "_PATIENCE", 0.0)
    listener, looked = Listener(), []
    craft = SimpleNamespace(clock=WallClock(), observe=lambda: looked.append(1))
    with jit_warmup.jit_warmup("udpin:0.0.0.0:14550", [], []) as worker:
        jit_warmup.await_warmup(craft, worker, listener)
    assert looked != []
    assert listener.said == [
        "loading numerical code. This takes up to a minute if it is not yet compiled on this computer"
    ], "true of compiled code, too"
