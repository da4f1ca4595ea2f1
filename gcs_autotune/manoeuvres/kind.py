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
    """A manoeuvre of a given size, as `identify --plan-next` weighs it: ``make(seconds)`` returns one so long.

    ``forces`` (letters with spaces between) it drives; ``closed``: whether its commands answer to the motion.
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
    name, help : its name, as records carry it, and what is done.
    excites : degrees of freedom it tells about. drives : forces it commands.
    make : a manoeuvre from options (SI and radians) by name: those of ``options``, besides ``throttle``, ``duration``,
        ``side`` (1 starboard, -1 port) and ``keep-still`` (1: an ROV's other axes are held); None when it is flown by
        ``command`` only.
    options : names in :data:`gcs_autotune.limits.LIMITS`.
    room : the free water it takes, in words; the preview says it in metres.
    identifies : whether its record is for identification. turns : whether the bow goes
        right round, or may (a craft that is let go of is held by nobody).
    needs_way : for craft that steer under way only. stays : for craft that stay where they are, and push either way.
    needs : a signal it cannot do without, that not every vehicle tells.
    tied : for a craft that is tied up: nothing is checked by its motion before, and it comes back from nowhere.
    presets : what `identify --plan-next` weighs.
    axis : the autopilot's own loop that flies it, where one does; its options are in that loop's units.
    command : what flies it when ``gcs-autotune fly`` does not.
    for_force : the same row for another force, of those that can be driven by the clock; see :meth:`of`.
    shrinks : option -> the power of a scale below 1 that makes it smaller or shorter, where the room asks for that.
    """

    name: str
    help: str
    excites: frozenset[str]
    drives: frozenset[str]
    make: Callable[[Mapping[str, float]], Manoeuvre] | None = None
    options: tuple[str, ...] = ()
    room: str = "about where the craft is"
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
            raise UsageError(f"{self.name} drives {' and '.join(sorted(self.drives))}; it takes no --force {force}")
        return self.for_force(force)

    def suits(self, firmware: Firmware) -> bool:
        """Whether a craft with this *firmware* has what it drives."""
        way = firmware.needs_way
        driven = self.drives <= set(firmware.channels) and (not self.axis or self.axis in firmware.axes)
        return driven and (way or not self.needs_way) and not (way and self.stays)
