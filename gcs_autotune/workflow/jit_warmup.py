"""Compile the functions that a tune will use, in the process that will run them, before arming.

The compiled functions are stored on disk, so only the first run after an installation needs up to a minute for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

import numpy as np

from gcs_autotune.clock import Deadline, ManualClock
from gcs_autotune.design import LAWS, Plant, Scenario, margins_of_each, step_metrics
from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify import fit, fit_axis
from gcs_autotune.identify.thrust import DEAD_ZONE, fit_with_actuator
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.models import SingleDof
from gcs_autotune.observer import Observer
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow.background import finish
from gcs_autotune.workflow.worker import Worker

__all__ = ["await_warmup", "jit_warmup", "warm_up"]

_PATIENCE = 2.0
"""Waiting time [s] after which the reason for the delay is reported."""
_LOCK_STEPPED = ("sitl:", "memory")
"""Prefixes of the URIs of vehicles whose time stands still during computations; one is that of a ``MemoryLink``."""
_MODEL = (1.0, 0.5)
"""Gain and drag [1/s] of the simulated craft; any values would do."""


@contextmanager
def jit_warmup(connection: str, dofs: Iterable[str], laws: Iterable[str]) -> Iterator[Worker]:
    """Yield a worker that compiles the identification of *dofs* and the control laws named *laws*.

    Nothing is done if *connection* (a URI) leads to a simulated vehicle whose time stands still during computations.
    """
    with Worker(apart=not connection.startswith(_LOCK_STEPPED)) as worker:
        if worker.apart:
            worker.begin(partial(warm_up, sorted(set(dofs)), sorted(set(laws))))
        yield worker


def await_warmup(craft: MavlinkCraft, worker: Worker, observer: Observer) -> None:
    """Wait until the *worker* is ready, and report the reason if this takes long. The craft is only monitored."""
    if not worker.apart or isinstance(craft.clock, ManualClock):
        return  # simulated time stands still during a computation
    told: Deadline | None = Deadline.after(craft.clock, _PATIENCE)

    def tell() -> None:
        nonlocal told
        if told is not None and told.expired:
            observer.say("loading numerical code. This takes up to a minute if it is not yet compiled on this computer")
            told = None

    finish(craft, worker, tell)


def warm_up(dofs: Sequence[str], laws: Sequence[str]) -> None:
    """Run identification in *dofs* and the control laws named *laws* once, on a simulated craft.

    Several *dofs* without a law belong to a coupled form.
    """
    if len(dofs) > 1 and not laws:
        with suppress(AutotuneError):  # as below
            fit([_swing(dofs)], dof="horizontal", delay=0.0)
        return
    for dof in dofs:
        _identify(dof)
        for law in (LAWS[name] for name in laws):
            gains = {**law.defaults, **law.fixed, **dict.fromkeys((*law.tuned, *law.measured), 1.0)}
            m = law.simulate(SingleDof(dof, "1", *_MODEL), gains, Scenario(step=0.1, duration=1.0), 1.0, 0.0)
            with suppress(AutotuneError):  # as below
                step_metrics(m.t, np.full_like(m.t, 0.1), m.position, m.output, noise_std=1e-3)
            margins_of_each(law.controller(gains, 1.0), [Plant(1.0, *_MODEL, 0.1)])


def _identify(dof: str) -> None:
    trial = _swing([dof])
    try:
        fit_with_actuator([trial], fit_axis([trial], dof=dof, structure="affine"), DEAD_ZONE)
    except AutotuneError:
        return  # a simulated craft need not allow a fit; what there was to compile is compiled


def _swing(dofs: Sequence[str]) -> Trial:
    """Return a simulated record of relay experiments in each of *dofs*, with different periods: 40 s at 10 Hz."""
    alpha, beta = _MODEL
    step = 0.1
    t = step * np.arange(400, dtype=np.float64)
    random = np.random.default_rng(1)
    channels: dict[str, Channel] = {}
    for number, dof in enumerate(dofs):
        d = DOFS[dof]
        force = 0.5 * np.sign(np.sin(2.0 * math.pi * t / (8.0 - 1.5 * number)) + 1e-9)
        speed, position = np.zeros(len(t)), np.zeros(len(t))
        for k in range(1, len(t)):
            speed[k] = speed[k - 1] + step * (alpha * force[k - 1] - beta * speed[k - 1])
            position[k] = position[k - 1] + step * speed[k]
        noise = random.normal(0.0, 1e-3, (2, len(t)))
        turns = d.velocity in ("p", "q", "r")
        channels[d.force] = Channel(d.force, "1", t, force)
        channels[d.velocity] = Channel(d.velocity, "rad/s" if turns else "m/s", t, speed + noise[0])
        channels[d.position] = Channel(d.position, "rad" if turns else "m", t, position + noise[1])
    return Trial("simulated", channels)
