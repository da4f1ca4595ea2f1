"""Other hands on the vehicle while we command it: whose they are, and that we let go at once."""

from __future__ import annotations

from gcs_autotune.errors import GuardTripped
from gcs_autotune.firmware import Firmware
from gcs_autotune.foreign_text import quoted
from gcs_autotune.link.beat import Beat
from gcs_autotune.link.company import Company
from gcs_autotune.link.parameters import Parameters
from gcs_autotune.link.session import Session
from gcs_autotune.link.sticks import Sticks

__all__ = ["Hands"]

_LOOK_BACK = 5.0
"""Chosen [s]: an order this old may be the cause of what is seen now; heartbeats show a mode a second late."""
_AHEAD = 1.5
"""A simulation whose time goes faster than the clock by this is said to run ahead."""
_FELT = 0.4
"""Chosen [s of the vehicle's time]: ArduRover without a receiver takes its pilot for lost after half a second."""
_MODE_ORDERS = frozenset({"SET_MODE", "MAV_CMD_DO_SET_MODE", "MAV_CMD_NAV_RETURN_TO_LAUNCH", "MAV_CMD_MISSION_START"})
_ARM_ORDERS = frozenset({"MAV_CMD_COMPONENT_ARM_DISARM", "MAV_CMD_DO_FLIGHTTERMINATION"})
_STICK_ORDERS = frozenset({"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"})


class Hands:
    """What is expected of the vehicle while it is ours, and a check of it at every tick.

    Attributes
    ----------
    mode : custom mode number that is expected, None while it is just being changed by us.
    armed : whether it is expected to be armed, None while that is just being changed by us.
    """

    def __init__(
        self,
        session: Session,
        firmware: Firmware,
        parameters: Parameters,
        company: Company,
        sticks: Sticks,
        beat: Beat,
    ) -> None:
        self._session = session
        self._firmware = firmware
        self._parameters = parameters
        self._company = company
        self._sticks = sticks
        self._beat = beat
        self.mode: int | None = None
        self.armed: bool | None = None

    def take_over(self) -> None:
        """From now on it is ours, as it is."""
        self.mode, self.armed = self._session.custom_mode, self._session.armed

    def change(self) -> None:
        """Mode and arming are about to be changed by us."""
        self.mode = self.armed = None

    def check(self) -> None:
        """Raise ``GuardTripped`` when somebody else has taken a hand, saying who as far as that can be known."""
        self._check_parameters()
        self._check_mode()
        self._check_armed()
        self._check_sticks()

    def _check_parameters(self) -> None:
        if self._parameters.intrusions:
            name, old, new = self._parameters.intrusions[0]
            raise GuardTripped(
                f"another ground station wrote {name} = {new:g} (it was {old:g}): "
                f"{self._who(frozenset({'PARAM_SET'}), name)}. Disconnect it and start again",
                guard="parameters",
                value=new,
                limit=old,
            )

    def _check_mode(self) -> None:
        if self.mode is not None and self._session.custom_mode != self.mode:
            expected, now = self._firmware.mode_name(self.mode), self._firmware.mode_name(self._session.custom_mode)
            self._see_our_pause(f"the vehicle went from {expected} to {now}", _MODE_ORDERS)
            raise GuardTripped(
                f"the vehicle went from {expected} to {now}, not by us{self._last_words()}: {self._who(_MODE_ORDERS)}",
                guard="mode",
            )

    def _check_armed(self) -> None:
        if self.armed and not self._session.armed:
            self._see_our_pause("the vehicle was disarmed", _ARM_ORDERS)
            raise GuardTripped(
                f"the vehicle was disarmed, not by us{self._last_words()}: {self._who(_ARM_ORDERS)}", guard="armed"
            )

    def _check_sticks(self) -> None:
        moved = self._sticks.moved_by_hand
        if moved is not None:
            raise GuardTripped(
                f"a pilot's hand: RC channel {moved[0]} of the vehicle's own receiver went from {moved[1]} to "
                f"{moved[2]} us. Leave the transmitter alone, or switched off, while this tool steers",
                guard="sticks",
                value=float(moved[2]),
                limit=float(moved[1]),
            )
        departed = self._sticks.departed
        if departed is not None:
            channel, sent, shown = departed
            raise GuardTripped(
                f"somebody else is steering: RC channel {channel} shows {shown} us where {sent} us were sent"
                f"{self._last_words()}: {self._who(_STICK_ORDERS)}. Unplug other joysticks; if there is none, our "
                "overrides do not get through",
                guard="sticks",
                value=float(shown),
                limit=float(sent),
            )

    def _see_our_pause(self, what: str, kinds: frozenset[str]) -> None:
        """Raise ``GuardTripped`` (guard ``pause``) when it was this computer that kept the vehicle waiting."""
        since = self._session.clock.now() - _LOOK_BACK
        pause, pace = self._beat.pause_since(since), max(self._beat.pace, 1.0)
        if pause * pace < _FELT or self._company.has_ordered(kinds, since):
            return
        ran = f", {pause * pace:.1f} s of the vehicle's time," if pace > _AHEAD else ""
        cure = "let the simulation run slower" if pace > _AHEAD else "close other programs"
        raise GuardTripped(
            f"{what}{self._last_words()}: this computer paused for {pause:.2g} s{ran} and sent no overrides meanwhile. "
            f"It was not the radio, nor another station: {cure}, and try again",
            guard="pause",
            value=pause * pace,
            limit=_FELT,
        )

    def _who(self, kinds: frozenset[str], name: str = "") -> str:
        moved = self._sticks.moved_by_hand
        if moved is not None and not name:
            return f"RC channel {moved[0]} went from {moved[1]} to {moved[2]} us just now, a switch on the transmitter"
        return self._company.culprit(kinds, self._session.clock.now() - _LOOK_BACK, name)

    def _last_words(self) -> str:
        texts = self._session.texts.recent(self._session.clock.now() - _LOOK_BACK)
        return f" (it says: {quoted(texts)})" if texts else ""
