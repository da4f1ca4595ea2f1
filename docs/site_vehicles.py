"""The directive ``vehicles``: every simulated vehicle with its manoeuvres, flown in open loop when the site is built.

The plant and its actuators are driven directly by servo pulses, without autopilot, sensors and MAVLink.
"""

from __future__ import annotations

import io
import math
import re
from collections import defaultdict
from collections.abc import Callable
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from docutils import nodes
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from sphinx.util.docutils import SphinxDirective

from sitl.catalogue import VEHICLES, VehicleData, load_vehicle
from sitl.craft import Craft

__all__ = ["Manoeuvres", "Vehicles", "drawn", "manoeuvres_of", "sources_of"]

Array = NDArray[np.float64]

STEP = 0.02
"""Time step [s], that of ArduRover's loop."""
THROTTLE, STEERING = 0.5, 0.3
"""Normalised outputs of all manoeuvres."""
ZIGZAG, RELEASED = math.radians(20.0), math.radians(10.0)
"""Heading change [rad] at which a zig-zag reverses the steering; roll and pitch [rad] at the start of a free decay."""
IMMERSED = 0.05
"""Depth [m] at which a floating body is released."""
TURNED, REVERSALS = 3.0 * math.pi, 5
"""Turn [rad] of a circle, and reversals of a zig-zag."""
LONGEST, OSCILLATION = 240.0, 8.0
"""Longest time [s] of a manoeuvre, and time [s] of a free oscillation."""
SETTLING, SETTLED = 2.0, 0.01
"""A speed is steady if it changes by less than this fraction in this time [s]."""
POINTS = 90
"""Most points of a line. A free decay has twice as many."""
BLUE, RED, GREY = "#0072b2", "#d55e00", "#888888"
COLUMNS = ("t", "x", "y", "z", "phi", "theta", "psi", "u", "r", "N")
SHAPE = ("odd", "dead")
"""Entries of ``[thruster]`` that still count beside ``[thrusters]``."""
NOT_MOTION = ("sensors", "link", "start", "parameters", "imu", "compass", "gps", "dvl", "pressure", "rangefinder")
"""Headings of a vehicle file whose numbers do not change its motion."""


class Manoeuvres(NamedTuple):
    """Records of one vehicle: columns of :data:`COLUMNS`, (n,) each, SI and radians; ``N`` is the normalised steering.

    ``run_up``: throttle step from rest. ``decay``: actuators neutral after the circle. ``release``: oscillation at rest
    after a release from :data:`RELEASED` and :data:`IMMERSED`, with ``t`` and only the columns released (``phi``,
    ``theta``, ``z``); empty if the vehicle has neither roll, pitch nor a waterplane.
    """

    run_up: dict[str, Array]
    circle: dict[str, Array]
    zigzag: dict[str, Array]
    decay: dict[str, Array]
    release: dict[str, Array]


class _Flight:
    """A craft in open loop that records its motion."""

    def __init__(self, data: VehicleData) -> None:
        self.craft = Craft(data)
        self.craft.begin("0")
        self.steps = 0
        self.rows: list[tuple[float, ...]] = []

    def fly(self, throttle: float, steering: float, ended: Callable[[], bool], longest: float = LONGEST) -> None:
        """Hold both outputs until *ended* or for *longest* [s]."""
        shares = defaultdict(float, X=throttle, N=steering)
        pwm = self.craft.actuators.write([1500] * 16, shares)
        at = self.craft.plant.state
        for _ in range(round(longest / STEP)):
            self.steps += 1
            t = self.steps * STEP
            self.craft.move(t, STEP, pwm)
            self.rows.append((t, at.x, at.y, at.z, at.phi, at.theta, at.psi, at.u, at.r, steering))
            if ended():
                break

    def record(self) -> dict[str, Array]:
        """Return the columns since the last call, with time from 0 [s]."""
        table = np.array(self.rows).T
        self.rows = []
        table[0] -= table[0, 0]
        return dict(zip(COLUMNS, table, strict=True))

    def run_up(self) -> dict[str, Array]:
        """Fly ahead until the speed is steady, or the craft has turned by itself, and return the record."""
        at, back, started = self.craft.plant.state, round(SETTLING / STEP), self.craft.plant.state.psi

        def steady() -> bool:
            if abs(at.psi - started) > ZIGZAG:
                return True
            return len(self.rows) > back and abs(at.u - self.rows[-back][7]) < SETTLED * abs(at.u)

        self.fly(THROTTLE, 0.0, steady)
        return self.record()


def manoeuvres_of(data: VehicleData) -> Manoeuvres:
    """Return the manoeuvres of a vehicle, flown in open loop."""
    flight = _Flight(data)
    at = flight.craft.plant.state
    run_up, before = flight.run_up(), at.psi
    flight.fly(THROTTLE, STEERING, lambda: abs(at.psi - before) > TURNED)
    circle, speed = flight.record(), abs(at.u)
    flight.fly(0.0, 0.0, lambda: abs(at.u) < 0.1 * speed)
    decay = flight.record()
    return Manoeuvres(run_up, circle, _zigzag(data), decay, _release(data))


def _zigzag(data: VehicleData) -> dict[str, Array]:
    flight = _Flight(data)
    at = flight.craft.plant.state
    flight.run_up()
    before, side = at.psi, 1.0
    for _ in range(REVERSALS):
        flight.fly(THROTTLE, side * STEERING, lambda s=side: s * (at.psi - before) > ZIGZAG, LONGEST / REVERSALS)
        side = -side
    return flight.record()


def _release(data: VehicleData) -> dict[str, Array]:
    released = {"phi": RELEASED} if "roll" in data.tables else {}
    released |= {"theta": RELEASED} if "pitch" in data.tables else {}
    released |= {"z": IMMERSED} if "waterplane" in data.tables.get("body", {}) else {}
    if not released:
        return {}
    flight = _Flight(data)
    at = flight.craft.plant.state
    for name, value in released.items():
        setattr(at, name, getattr(at, name) + value)
    flight.fly(0.0, 0.0, lambda: False, OSCILLATION)
    record = flight.record()
    return {name: record[name] for name in ("t", *released)}


def sources_of(data: VehicleData) -> str:
    """Return one line: the sources of the numbers of hull and actuators, and how many of the numbers are assumed."""
    found = []
    for heading, table in data.tables.items():
        if heading in NOT_MOTION or not isinstance(table, dict):
            continue
        used = SHAPE if heading == "thruster" and "thrusters" in data.tables else table
        found += [str(table[name]["source"]).partition(":")[0] for name in used if name in table]
    cited = {re.split(r",| \(", source)[0] for source in found}
    names = ", ".join(sorted(cited - {"Chosen", "ArduSub", "ArduRover"})) or "none"
    return f"Sources: {names}. Assumed: {found.count('Chosen')} of {len(found)} numbers."


def _line(axes: Axes, t: Array, values: Array, points: int = POINTS, **more: Any) -> None:
    step = -(-len(t) // points)
    axes.plot(np.round(t[::step], 3), np.round(values[::step], 4), lw=1.0, **more)


def drawn(seen: Manoeuvres) -> Figure:
    """Return the four panels: circle, zig-zag, steps and free decay."""
    figure = Figure(figsize=(9.0, 2.1))
    panels = figure.subplots(1, 4)
    figure.subplots_adjust(left=0.055, right=0.955, bottom=0.21, top=0.87, wspace=0.36)
    circle, zigzag, steps, decay = panels
    _line(circle, seen.circle["y"] - seen.circle["y"][0], seen.circle["x"] - seen.circle["x"][0], color=BLUE)
    circle.set_aspect("equal", adjustable="datalim")
    circle.set(title="circle", xlabel="east [m]", ylabel="north [m]")
    record = seen.zigzag
    _line(zigzag, record["t"], np.degrees(record["psi"] - record["psi"][0]), color=BLUE, label="heading [°]")
    changes = np.flatnonzero(np.diff(record["N"], prepend=np.nan, append=np.nan))
    changes = np.minimum(changes, len(record["t"]) - 1)
    steered = 100.0 * record["N"][changes]
    zigzag.step(record["t"][changes], steered, where="post", color=GREY, lw=0.7, label="steering [%]")
    low, high = zigzag.get_ylim()
    zigzag.set(title="zig-zag", xlabel="t [s]", ylim=(low, high + 0.4 * (high - low)))
    zigzag.legend(frameon=False, loc="upper right")
    _line(steps, seen.run_up["t"], seen.run_up["u"], color=BLUE, label="u [m/s], throttle")
    beside = steps.twinx()
    _line(beside, seen.circle["t"], np.degrees(seen.circle["r"]), color=RED, label="r [°/s], steering")
    beside.tick_params(axis="y", colors=RED)
    steps.tick_params(axis="y", colors=BLUE)
    steps.legend(handles=[*steps.lines, *beside.lines], frameon=False, loc="lower right")
    shown = min(2.0 * seen.run_up["t"][-1], max(seen.run_up["t"][-1], seen.circle["t"][-1]))
    steps.set(title="steps", xlabel="t [s]", xlim=(0.0, shown), ylim=(min(0.0, *steps.get_ylim()), None))
    beside.set(ylim=(min(0.0, *beside.get_ylim()), None))
    beside.spines["top"].set_visible(False)
    for label, t, values, start, color in _decays(seen):
        _line(decay, t, 100.0 * values / start, 2 * POINTS, color=color, label=label)
    decay.set(title="free decay [%]", xlabel="t [s]")
    decay.legend(frameon=False, loc="upper right")
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    return figure


def _decays(seen: Manoeuvres) -> list[tuple[str, Array, Array, float, str]]:
    """Return label, time [s], values, initial value and colour of each line of the free decay."""
    if not seen.release:
        lines = [(name, seen.decay["t"], seen.decay[name], float(seen.decay[name][0])) for name in ("u", "r")]
    else:
        kinds = {"phi": ("roll", RELEASED), "theta": ("pitch", RELEASED), "z": ("heave", IMMERSED)}
        t = seen.release["t"]
        lines = [(kinds[k][0], t, values, kinds[k][1]) for k, values in seen.release.items() if k in kinds]
    return [(*line, color) for line, color in zip(lines, (BLUE, RED, GREY), strict=False)]


def picture_of(data: VehicleData) -> str:
    """Return the vehicle's plots as SVG."""
    look = {"svg.fonttype": "none", "svg.hashsalt": "vehicles", "font.size": 7.5, "legend.fontsize": 6.0}
    text = io.StringIO()
    with matplotlib.rc_context(look):
        drawn(manoeuvres_of(data)).savefig(text, format="svg", metadata={"Date": None})
    picture = text.getvalue()[text.getvalue().index("<svg") :]
    label = f"circle, zig-zag, steps and free decay of {data.name}"
    return picture.replace("<svg ", f'<svg role="img" aria-label="{label}" style="max-width:100%;height:auto" ', 1)


class Vehicles(SphinxDirective):
    """Show a section for each simulated vehicle: name, title, sources and plots."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        return [self._section(load_vehicle(name)) for name in VEHICLES]

    def _section(self, data: VehicleData) -> nodes.section:
        section = nodes.section(ids=[data.name], names=[data.name])
        section += nodes.title(data.name, data.name)
        section += nodes.paragraph("", f"{data.title}. {sources_of(data)}")
        section += nodes.raw("", picture_of(data), format="html")
        return section
