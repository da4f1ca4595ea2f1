"""The link module: convert bytes to and from the vehicle into a craft that manoeuvres can fly.

Only this module uses sockets, serial ports and MAVSDK. Code that needs none of them is in ``mavlink``.
From the wire up:

* ``transports``: :func:`open_link`, with one file per kind of connection; ``ports``: the existing ports and the senders
  on them;
* ``session``: periodic tasks and the operator's stop. Its parts are ``frame_port`` (frames, signing, log), ``routing``
  (listeners), ``liveness`` (the accepted sender and its silence) and ``discovery`` of the vehicle;
* ``distance_sender``: send distances to the vehicle, like a companion computer;
* ``parameters``: ``exchange`` (request and answer), ``client`` (:class:`Parameters`), ``journal`` and
  ``parameter_transaction`` (temporary changes: verify, restore);
* ``vehicle``, commanding: ``commands`` (modes, arming), ``setpoint_streamer`` (repeats set-points), ``rc_monitor``
  (whether the vehicle obeys them), ``actuation_check`` (the same at arming), ``congestion`` (whether the link has
  capacity for them), ``mission_transfer`` and ``script_loan`` (a mission or a Lua script of ours for a while);
* ``vehicle``, receiving: ``rates``, fitted by ``bandwidth``; ``telemetry`` with ``watchdog``; ``latency`` (delays);
* ``vehicle``, other senders: ``interference_monitor`` (their effects), ``other_stations`` (their identity);
* ``vehicle``, configuration: ``vehicle_config`` (wiring); ``mavlink_craft`` (:class:`MavlinkCraft`), assembled by
  :func:`open_craft` (``handshake``).
"""

from __future__ import annotations

from gcs_autotune.link.distance_sender import DistanceSender
from gcs_autotune.link.onboard_logs import OnboardLog, fetch_log, list_logs
from gcs_autotune.link.parameters.client import Parameters
from gcs_autotune.link.parameters.exchange import same_float32
from gcs_autotune.link.parameters.journal import Journal, JournalState, is_being_written
from gcs_autotune.link.parameters.parameter_transaction import ParameterTransaction
from gcs_autotune.link.ports import BAUDS, Overheard, PortSeen, overhear, serial_ports
from gcs_autotune.link.session import Session
from gcs_autotune.link.transports import BACKENDS, TRANSPORTS, is_serial, open_link
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
    is_ours,
    read_mission,
    same_mission,
    set_current,
    waypoint,
    write_mission,
)
from gcs_autotune.link.vehicle.rates import Granted, Rates
from gcs_autotune.link.vehicle.script_loan import ScriptLoan, drop_script, script_folder
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
    "DistanceSender",
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
    "ScriptLoan",
    "Session",
    "StoredMission",
    "Transport",
    "VehicleConfig",
    "difference",
    "drop_script",
    "fetch_log",
    "fingerprint_of",
    "is_being_written",
    "is_ours",
    "is_serial",
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
    "script_folder",
    "serial_ports",
    "set_current",
    "waypoint",
    "write_mission",
]
