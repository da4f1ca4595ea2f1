"""The link room: bytes to and from the vehicle, turned into a craft that manoeuvres can fly.

The only room that knows sockets, serial ports and MAVSDK; what needs none of them is in ``mavlink``. From the wire up:

* ``transports``: :func:`open_link` and one file per kind of connection; ``ports``: which there are, who talks on them;
* ``session``, made of ``frame_port`` (frames, signing, log), ``routing`` (who is told), ``liveness`` (whom we hear, how
  long silent), periodic tasks and the operator's stop; ``discovery`` of the vehicle among what is heard;
* ``parameters``: ``exchange`` (question and answer), ``client`` (:class:`Parameters`), ``journal`` and
  ``parameter_transaction`` (borrow, verify, give back);
* ``vehicle``: ``commands``; ``rates`` fitted by ``bandwidth``; ``telemetry`` with ``watchdog``; ``setpoint_streamer``
  keeps commands in force, ``rc_monitor`` sees whether they are, ``actuation_check`` proves it at arming,
  ``congestion`` that there is room for them; ``interference_monitor`` notices others, ``other_stations`` knows whom,
  ``latency`` how late all is; ``vehicle_config`` how it is wired; ``mavlink_craft`` (:class:`MavlinkCraft`), put
  together by :func:`open_craft` (``handshake``).
"""

from __future__ import annotations

from gcs_autotune.link.onboard_logs import OnboardLog, fetch_log, list_logs
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.parameters.exchange import same_float32
from gcs_autotune.link.parameters.journal import Journal, JournalState, is_being_written
from gcs_autotune.link.parameters.parameter_transaction import ParameterTransaction
from gcs_autotune.link.ports import BAUDS, Overheard, PortSeen, overhear, serial_ports
from gcs_autotune.link.session import Session
from gcs_autotune.link.transports import BACKENDS, TRANSPORTS, open_link
from gcs_autotune.link.transports.memory import MemoryLink, Peer
from gcs_autotune.link.transports.transport import Transport
from gcs_autotune.link.vehicle.actuation_check import TWITCH, read_outputs
from gcs_autotune.link.vehicle.commands import Commands
from gcs_autotune.link.vehicle.fence import FENCE_PARAMETERS, FenceItem, read_fence
from gcs_autotune.link.vehicle.handshake import NEEDED_RATES, WANTED_RATES, difference, fingerprint_of, open_craft
from gcs_autotune.link.vehicle.mavlink_craft import MavlinkCraft, read_failsafes
from gcs_autotune.link.vehicle.mission_transfer import (
    MissionItem,
    MissionLoan,
    StoredMission,
    read_mission,
    same_mission,
    set_current,
    waypoint,
    write_mission,
)
from gcs_autotune.link.vehicle.rates import Granted, Rates
from gcs_autotune.link.vehicle.vehicle_config import VehicleConfig

__all__ = [
    "BACKENDS",
    "BAUDS",
    "FENCE_PARAMETERS",
    "NEEDED_RATES",
    "TRANSPORTS",
    "TWITCH",
    "WANTED_RATES",
    "Commands",
    "FenceItem",
    "Granted",
    "Journal",
    "JournalState",
    "MavlinkCraft",
    "MemoryLink",
    "MissionItem",
    "MissionLoan",
    "OnboardLog",
    "Overheard",
    "ParameterTransaction",
    "Parameters",
    "Peer",
    "PortSeen",
    "Rates",
    "Session",
    "StoredMission",
    "Transport",
    "VehicleConfig",
    "difference",
    "fetch_log",
    "fingerprint_of",
    "is_being_written",
    "list_logs",
    "open_craft",
    "open_link",
    "overhear",
    "read_failsafes",
    "read_fence",
    "read_mission",
    "read_outputs",
    "same_float32",
    "same_mission",
    "serial_ports",
    "set_current",
    "waypoint",
    "write_mission",
]
