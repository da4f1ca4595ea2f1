"""A row of the table of manoeuvres: what each is called, excites, needs, and how one is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from gcs_autotune.errors import UsageError
from gcs_autotune.firmware import Firmware
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre

__all__ = ["ManoeuvreKind", "Preset"]


@dataclass(frozen=True, slots=True)
class Preset:
    """A candidate manoeuvre of `identify --plan-next`: ``make(seconds)`` returns one of that duration.

    ``forces``: letters it drives, separated by spaces; ``closed``: whether its commands depend on the motion.
    """

    title: str
    forces: str
    make: Callable[[float], Manoeuvre]
    closed: bool = False

    @property
    def name(self) -> str:
        """The title without spaces and signs."""
        plain = self.title.replace("%", "").replace("/", "-").replace(",", "").replace("  ", " ")
        return plain.replace(" ", "-").rstrip("-")

    @property
    def drives(self) -> frozenset[str]:
        """The forces, one by one."""
        return frozenset(self.forces.split())


@dataclass(frozen=True, slots=True)
class ManoeuvreKind:
    """One kind of manoeuvre.

    Attributes
    ----------
    name, help : its name in records, and its description.
    excites : degrees of freedom it excites. drives : forces it commands.
    make : a manoeuvre from options (SI and radians) by name: those of ``options``, and ``throttle``, ``duration``,
        ``side`` (1 starboard, -1 port) and ``keep-still`` (1: hold an ROV's other axes); None if only ``command``
        flies it.
    options : names in :data:`gcs_autotune.limits.LIMITS`.
    room : the space it needs, in words; the preview has metres.
    identifies : whether its record is for identification. turns : whether the heading may change by a full turn.
    needs_way : for craft that steer only under way. stays : for craft that hold position and thrust in both directions.
    needs : a required signal that not every vehicle reports.
    tied : for a tied craft: no check by motion, and no way back.
    presets : candidates of `identify --plan-next`.
    axis : the autopilot's own loop that flies it, if any; its options are in that loop's units.
    command : the command that flies it, if not ``gcs-autotune fly``.
    for_force : the same row for another force, of those that an open-loop programme can drive; see :meth:`of`.
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
    for_force: Callable[[str], ManoeuvreKind] | None = None
    shrinks: Mapping[str, float] = field(default_factory=dict)

    def of(self, force: str) -> ManoeuvreKind:
        """Return the row for *force* (``X`` to ``N``; empty: as it is).

        Raises
        ------
        UsageError
            It drives no other force than its own.
        """
        if not force or self.drives == {force}:
            return self
        if self.for_force is None:
            raise UsageError(
                f"{self.name} drives {' and '.join(sorted(self.drives))} and does not accept --force {force}"
            )
        return self.for_force(force)

    def suits(self, firmware: Firmware) -> bool:
        """Whether a craft with this *firmware* has what it drives."""
        way = firmware.needs_way
        driven = self.drives <= set(firmware.channels) and (not self.axis or self.axis in firmware.axes)
        return driven and (way or not self.needs_way) and not (way and self.stays)
