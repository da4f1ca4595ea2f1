"""Another ground station that asks for its own stream rates changes ours: notice it, ask again, say so."""

from __future__ import annotations

from collections import Counter
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
            for name in _VITAL:
                self._judge(name, self._counts[name] / span)
        self._counts.clear()
        self._begun = self._stamp

    def _judge(self, name: str, rate: float) -> None:
        granted, usual = self._rates.granted.get(name), self._rates.measured.get(name, 0.0)
        if granted is None or granted.granted <= 0.0 or rate >= _LOW * usual or usual <= 0.0:
            return
        self._ask_again(name, granted.granted)
        if name not in self._noted:
            self._noted.add(name)
            who = self._company.culprit(_REQUESTS, self._session.clock.now() - _LOOK_BACK)
            self._session.notes.append(f"{name} came at {rate:.1f} Hz only and was asked for again ({who})")

    def _ask_again(self, name: str, rate: float) -> None:
        vehicle = self._session.vehicle
        if vehicle is not None:
            wanted = (float(message_number(name)), 1e6 / rate, 0.0, 0.0, 0.0, 0.0, 0.0)
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self._session.send(
                mavlink.MAVLink_command_long_message(vehicle.system, vehicle.component, command, 0, *wanted)
            )
