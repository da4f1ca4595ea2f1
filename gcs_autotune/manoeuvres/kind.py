"""Entries of the table of manoeuvres: name, excitation, requirements, and the function that creates the manoeuvre."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from gcs_autotune.axes import AXES, AxisKind
from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import Firmware
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre

__all__ = ["ManoeuvreKind", "Preset", "of_loop"]


@dataclass(frozen=True, slots=True)
class Preset:
    """A candidate manoeuvre for `identify --plan-next`; ``make(seconds)`` returns one of that duration.

    ``forces``: letters of the forces that it drives, separated by spaces. ``closed``: whether its commands depend on
    the motion.
    """

    title: str
    forces: str
    make: Callable[[float], Manoeuvre]
    closed: bool = False

    @property
    def name(self) -> str:
        """Name of the candidate: the title without spaces and punctuation."""
        plain = self.title.replace("%", "").replace("/", "-").replace(",", "").replace("  ", " ")
        return plain.replace(" ", "-").rstrip("-")

    @property
    def drives(self) -> frozenset[str]:
        """Letters of the forces that the candidate drives."""
        return frozenset(self.forces.split())


@dataclass(frozen=True, slots=True)
class ManoeuvreKind:
    """One kind of manoeuvre: an entry of the table.

    Attributes
    ----------
    name, help : its name in records, and its description.
    excites : degrees of freedom that it excites. drives : forces that it commands.
    make : function that creates it from options (SI and radians) by name: those of ``options``, and ``throttle``,
        ``duration``,
        ``side`` (1 starboard, -1 port) and ``keep-still`` (1: hold an ROV's other axes); None if ``command`` creates
        it.
    options : names in :data:`gcs_autotune.limits.LIMITS`.
    room : text on the required space; the preview computes it in metres.
    identifies : whether its record is for identification. turns : whether the heading may change by a full turn.
    needs_way : whether it is for craft that steer only under way. stays : whether it is for craft that hold position
        and have thrust in both directions.
    needs : a required signal that not every vehicle reports.
    tied : whether the craft is tied up; then there is no check by motion and no return.
    presets : candidates of `identify --plan-next`.
    axis : the autopilot's own loop that flies it, if any; its options are in that loop's units.
    command : the command that flies it, if not ``gcs-autotune fly``; see :attr:`is_alone`.
    layered : whether it is flown over our own loops, which are designed from a model first. timed : whether it takes
        timed points.
    for_force : function that returns this row for another force of an open-loop programme; see :meth:`of`.
    shrinks : option -> power of the scale (below 1) that reduces it to fit the space.
    """

    name: str
    help: str
    excites: frozenset[str]
    drives: frozenset[str]
    make: Callable[[Mapping[str, float]], Manoeuvre] | None = None
    options: tuple[str, ...] = ()
    room: str = "at the spot"
    identifies: bool = True
    turns: bool = False
    needs_way: bool = False
    stays: bool = False
    needs: str = ""
    tied: bool = False
    presets: tuple[Preset, ...] = ()
    axis: str = ""
    command: str = "fly"
    layered: bool = False
    timed: bool = False
    for_force: Callable[[str], ManoeuvreKind] | None = None
    shrinks: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_alone(self) -> bool:
        """Whether a person can fly it by itself, with ``gcs-autotune fly``."""
        return self.command == "fly"

    def of(self, force: str) -> ManoeuvreKind:
        """Return this entry of the table for *force* (``X`` to ``N``; empty: unchanged).

        Raises
        ------
        UsageError
            The manoeuvre cannot drive another force.
        """
        if not force or self.drives == {force}:
            return self
        if self.for_force is None:
            raise UsageError(
                f"{self.name} drives {' and '.join(sorted(self.drives))} and does not accept --force {force}"
            )
        return self.for_force(force)

    def suits(self, firmware: Firmware) -> bool:
        """Return whether a craft with this *firmware* has the actuators that the manoeuvre drives."""
        way = firmware.needs_way
        driven = self.drives <= set(firmware.channels) and (not self.axis or self.axis in firmware.axes)
        return driven and (way or not self.needs_way) and not (way and self.stays)


def of_loop(row: Callable[[AxisKind], ManoeuvreKind], force: str) -> ManoeuvreKind:
    """Return the *row* for the autopilot's loop that drives *force*: heading (N), depth (Z), a boat's speed (X).

    Raises
    ------
    UsageError
        The autopilot has no such loop.
    """
    axis = next((a for a in AXES.values() if a.names.force == force), None)
    if axis is None:
        raise UsageError(f"the autopilot has no loop for {force}. Use N (heading), Z (depth) or X (speed)")
    return row(axis)
