"""Another ground station that asks for its own stream rates changes ours: notice it, ask again, say so."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import partial

from gcs_autotune.link.company import Company
from gcs_autotune.link.rates import Rates, message_number
from gcs_autotune.link.session import Session
from gcs_autotune.link.wire import Message, mavlink

__all__ = ["RateKeeper"]

_VITAL = ("ATTITUDE", "SERVO_OUTPUT_RAW", "RC_CHANNELS")
_WINDOW = 2.0
"""Chosen [s of the vehicle's time]: long enough to tell a lost message from a changed rate."""
_LOW = 0.6
"""Chosen: share of the rate measured at boarding below which it is asked for again."""
_REQUESTS = frozenset({"REQUEST_DATA_STREAM", "MAV_CMD_SET_MESSAGE_INTERVAL"})
_LOOK_BACK = 10.0


class RateKeeper:
    """Counts what we cannot do without, and asks again when it thins out. Call :meth:`start` once rates are known."""

    def __init__(self, session: Session, rates: Rates, company: Company) -> None:
        self._session = session
        self._rates = rates
        self._company = company
        self._counts: Counter[str] = Counter()
        self._stamp = self._begun = 0.0
        self._noted: set[str] = set()

    def start(self) -> None:
        """From now on the rates last measured are kept."""
        for name in _VITAL:
            self._session.listen(name, partial(self._on_message, name))
        self._session.every(1.0, self._look)

    def _on_message(self, name: str, m: Message) -> None:
        self._counts[name] += 1
        if name != "SERVO_OUTPUT_RAW":  # its stamp is in microseconds, and wraps
            self._stamp = m.time_boot_ms * 1e-3

    def _look(self) -> None:
        span = self._stamp - self._begun
        if 0.0 <= span < _WINDOW:
            return
        if span <= 5.0 * _WINDOW and self._begun > 0.0:
            self._judge({name: self._counts[name] / span for name in _VITAL})
        self._counts.clear()
        self._begun = self._stamp

    def _judge(self, rates: Mapping[str, float]) -> None:
        thin = {}
        for name, rate in rates.items():
            granted, usual = self._rates.granted.get(name), self._rates.measured.get(name, 0.0)
            if granted is not None and granted.granted > 0.0 and rate < _LOW * usual:
                self._ask_again(name, granted.granted)
                thin[name] = f"{name} at {rate:.1f} Hz instead of {usual:.1f}"
        if set(thin) - self._noted:
            self._noted |= set(thin)
            who = self._company.culprit(_REQUESTS, self._session.clock.now() - _LOOK_BACK)
            self._session.notes.append(
                f"for a while {', '.join(thin.values())} came, asked for again: lost on the way, or another station "
                f"has asked for other rates ({who})"
            )

    def _ask_again(self, name: str, rate: float) -> None:
        vehicle = self._session.vehicle
        if vehicle is not None:
            wanted = (float(message_number(name)), 1e6 / rate, 0.0, 0.0, 0.0, 0.0, 0.0)
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._session.send(
                mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, 0, *wanted)
            )
