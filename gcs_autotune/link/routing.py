"""Route received frames: the vehicle's messages to their listeners, all others to the monitors."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable

from gcs_autotune.mavlink import Frame, Message

__all__ = ["Listener", "Routing"]

Listener = Callable[[Message], None]


class Routing:
    """The listeners of a session, and message counts per sender on its link.

    Attributes
    ----------
    foreign : (system, component) -> number of messages received from other senders.
    traffic : message name -> bytes received from all senders.
    """

    def __init__(self, notes: list[str]) -> None:
        self._notes = notes
        self._listeners: dict[str, list[Listener]] = defaultdict(list)
        self._overhearing: list[Callable[[Frame], None]] = []
        self._twins: set[tuple[int, int]] = set()
        self.foreign: Counter[tuple[int, int]] = Counter()
        self.traffic: Counter[str] = Counter()

    def listen(self, name: str, listener: Listener) -> Callable[[], None]:
        """Call *listener* with every message *name* of the vehicle. Return a function that stops this."""
        self._listeners[name].append(listener)
        return lambda: self._listeners[name].remove(listener)

    def overhear(self, listener: Callable[[Frame], None]) -> None:
        """Call *listener* with every frame of other senders."""
        self._overhearing.append(listener)

    def tell(self, frame: Frame) -> None:
        """Pass a message of the vehicle to the listeners for that message."""
        for listener in tuple(self._listeners.get(frame.name, ())):
            listener(frame.message)

    def note_other_station(self, frame: Frame, our_system: int) -> None:
        """Count a frame of another sender, and pass it to the monitors. Report once if a station uses our own
        system id.
        """
        self.foreign[frame.system, frame.component] += 1
        for hear in self._overhearing:
            hear(frame)
        is_twin = frame.name == "HEARTBEAT" and frame.system == our_system
        if is_twin and (frame.system, frame.component) not in self._twins:
            self._twins.add((frame.system, frame.component))
            self._notes.append(
                f"another station on this link also has system id {frame.system}. The vehicle cannot distinguish it "
                "from this tool and obeys both. Close the other station"
            )
