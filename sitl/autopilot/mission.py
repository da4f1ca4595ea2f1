"""The stored mission and how far it has come.

Source: ArduPilot's ``libraries/AP_Mission``. Item 0 is home. A navigation command ends when its verification is true;
the other commands between two of them run one a loop, beginning as the later one starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from sitl.place import to_plane

__all__ = ["MOST_ITEMS", "Command", "Crew", "Mission", "MissionItem", "Progress"]

MOST_ITEMS = 724
"""Items that fit into an ArduPilot board's 16 kB, with home."""


class Command(IntEnum):
    """MAV_CMD of what can be stored; each also has the short name that the firmware announces."""

    WAYPOINT = 16
    LOITER_UNLIMITED = 17
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    CHANGE_SPEED = 178

    @property
    def label(self) -> str:
        """The firmware's name."""
        return {16: "WP", 17: "LoitUnlim", 19: "LoitTime", 20: "RTL", 178: "ChangeSpeed"}[self]

    @property
    def navigates(self) -> bool:
        """Whether it is a navigation command (MAV_CMD_NAV_LAST is 95)."""
        return self <= 95

    @property
    def has_place(self) -> bool:
        """Whether its x and y are a latitude and a longitude."""
        return self in (Command.WAYPOINT, Command.LOITER_UNLIMITED, Command.LOITER_TIME)


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item as uploaded: MAV_FRAME, four parameters, latitude and longitude [1e-7 deg], altitude [m]."""

    command: Command
    frame: int = 3
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    latitude: int = 0
    longitude: int = 0
    altitude: float = 0.0

    @property
    def place(self) -> complex | None:
        """The place [m]; None where latitude and longitude are 0: wherever the craft is."""
        return to_plane(self.latitude, self.longitude) if self.latitude or self.longitude else None


class Progress(IntEnum):
    """MISSION_STATE."""

    STOPPED = 2
    RUNNING = 3
    COMPLETE = 5


class Crew(Protocol):
    """Who carries out the commands."""

    def start(self, index: int, item: MissionItem) -> bool:
        """Start a command; return whether that worked."""

    def verify(self, index: int, item: MissionItem) -> bool:
        """Return whether a command has been carried out."""

    def finish(self) -> None:
        """The mission is complete."""


class Mission:
    """``items`` with home as item 0, which is never flown; ``current`` is the navigation command of now, 0 before any.

    ``version`` counts changes of the items.
    """

    def __init__(self) -> None:
        self.items: list[MissionItem] = []
        self.version = 0
        self.progress = Progress.STOPPED
        self.current = 0
        self._loaded = False
        self._next_do: int | None = None
        self._first = 1

    def store(self, items: Sequence[MissionItem]) -> None:
        """Replace all items. A mission under way goes on with the new ones."""
        self.items = list(items)
        self.version += 1

    def rewind(self) -> None:
        """Go back to before the first command."""
        self.current, self._loaded, self._next_do = 0, False, None

    def clear(self, *, armed: bool) -> bool:
        """Forget the mission; return whether that was allowed (it is not while it runs)."""
        if armed and self.progress is Progress.RUNNING:
            return False
        self.store([])
        self.rewind()
        self.progress = Progress.STOPPED
        return True

    def next_after(self, index: int) -> MissionItem | None:
        """Return the navigation command that follows item *index*."""
        return next((item for item in self.items[index + 1 :] if item.command.navigates), None)

    def start(self, crew: Crew) -> None:
        """Run from the first command."""
        self.progress, self.current, self._loaded = Progress.RUNNING, 0, False
        if not self._advance(1, crew):
            self._complete(crew)

    def stop(self) -> None:
        """Leave the mission where it is."""
        if self.progress is Progress.RUNNING:
            self.progress = Progress.STOPPED
            self._first = self.current

    def resume(self, crew: Crew) -> None:
        """Start again the command that was interrupted; a mission that is complete starts from the first command."""
        if self.progress is Progress.COMPLETE or not 0 < self.current < len(self.items):
            self.start(crew)
        elif self.progress is Progress.STOPPED:
            self.progress = Progress.RUNNING
            self.set_current(self._first, crew)

    def set_current(self, index: int, crew: Crew) -> bool:
        """Go on with item *index* (0: the first), at once or on resuming; return whether there is such an item."""
        if index >= len(self.items) or len(self.items) == 1:
            return False
        first = max(index, 1)
        self._loaded, self._next_do = False, None
        if self.progress is Progress.RUNNING:
            if self._advance(first, crew):
                return True
            self._complete(crew)
            return False
        wanted = next((k for k in range(first, len(self.items)) if self.items[k].command.navigates), 0)
        self.current, self._first = wanted, first
        if wanted:
            self.progress = Progress.STOPPED
        return wanted > 0

    def update(self, crew: Crew) -> None:
        """Go on once the present command has been carried out."""
        if self.progress is not Progress.RUNNING or not self.items:
            return
        done = not self._loaded or self.current >= len(self.items)
        if done or crew.verify(self.current, self.items[self.current]):
            self._loaded = False
            if not self._advance(self.current + 1, crew):
                self._complete(crew)
                return
        if self._next_do is not None:
            self._do(self._next_do, crew)

    def _advance(self, index: int, crew: Crew) -> bool:
        """Start the first navigation command from *index* on that can be started; return whether there is one."""
        self._next_do = None
        for k in range(index, len(self.items)):
            item = self.items[k]
            if not item.command.navigates:
                if self._next_do is None:
                    self._do(k, crew)
                continue
            self.current = k
            if crew.start(k, item):
                self._loaded = True
                return True
        return False

    def _do(self, index: int, crew: Crew) -> None:
        """Run the command *index*, unless it navigates; the next one is due one loop later."""
        self._next_do = None
        if index < len(self.items) and not self.items[index].command.navigates:
            self._next_do = index + 1
            crew.start(index, self.items[index])
            crew.verify(index, self.items[index])

    def _complete(self, crew: Crew) -> None:
        self.progress = Progress.COMPLETE
        crew.finish()
