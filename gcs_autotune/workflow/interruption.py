"""A vehicle that falls silent for some seconds: it is waited for, made neutral, and what was under way is begun again.

Its failsafes may have disarmed it and changed its mode meanwhile; so may somebody beside it, which nobody heard. What
we had armed, as announced, is armed again after asking; what was found armed is not. A vehicle that has restarted is
another story: its estimator and message rates are gone.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from gcs_autotune.errors import AutotuneError, GuardTripped, LinkLost
from gcs_autotune.link import MavlinkCraft

__all__ = ["MOST", "Patience"]

MOST = 5
"""Chosen: interruptions borne in one run; a link that breaks more often is no link to tune over."""
_TELLING = 1.5
"""Chosen [s]: a silence that a vehicle's failsafes may have acted on."""
_LATELY = 10.0
"""Chosen [s]: so long ago it may be the cause of what is seen now."""
_HERE = 1.0


class Patience:
    """How interruptions of one run are borne.

    Parameters
    ----------
    seconds : longest silence that is waited out; 0 for none.
    say : where it is told. ask : whether it may be armed again.
    """

    def __init__(
        self, craft: MavlinkCraft, seconds: float, say: Callable[[str], None], ask: Callable[[str], bool]
    ) -> None:
        self._craft = craft
        self._seconds = seconds
        self._say, self._ask = say, ask
        self._found_armed = craft.armed
        self._borne = 0

    def bear(self, error: AutotuneError) -> bool:
        """Return whether *error* was a silence that is over, and the craft is neutral and as it was before.

        Raises
        ------
        OperatorStopped
            Ctrl-C while waiting.
        """
        if self._seconds <= 0.0 or self._borne >= MOST or not self._is_interruption(error):
            return False
        self._borne += 1
        if not self._is_back() or self._craft.telemetry.watchdog.fault is not None:
            return False
        try:
            return self._make_ready()
        except LinkLost:
            return False

    def _is_interruption(self, error: AutotuneError) -> bool:
        if isinstance(error, LinkLost):
            return True
        if not isinstance(error, GuardTripped):
            return False
        was_silent = self._craft.session.liveness.longest(_LATELY) > _TELLING
        return error.guard == "pause" or (error.guard in ("mode", "armed") and was_silent)

    def _is_back(self) -> bool:
        """Wait for the vehicle, as long as was stated."""
        session = self._craft.session
        if session.liveness.unheard <= _HERE:
            return session.liveness.longest(_LATELY) <= self._seconds
        left = self._seconds - session.liveness.unheard
        if left <= 0.0:
            return False
        self._say(
            f"silent for {session.liveness.unheard:.0f} s: waiting {left:.0f} s more (--patience) to go on; "
            "Ctrl-C ends it"
        )
        with suppress(LinkLost):
            return session.await_return(left)
        return False

    def _make_ready(self) -> bool:
        craft = self._craft
        craft.await_heartbeat()
        if not craft.armed:
            if self._found_armed:
                return False
            if not self._ask(
                "It was disarmed during the silence, by a failsafe or by somebody. Arm it again and go on?"
            ):
                return False
            self._say("arming it again, as announced")
            craft.arm()
        craft.neutral()
        return True
