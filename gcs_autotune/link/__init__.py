"""The link room: bytes to and from the vehicle, turned into a craft that manoeuvres can fly.

The only room that knows serial ports, and with ``logs`` the only one that knows pymavlink. Its parts, from the wire up:

* ``open_link`` (``uri``) and the transports ``udp``, ``tcp``, ``serial_port``, ``mavsdk_link``, ``child``, ``memory``;
* ``wire`` frames, ``signing`` them, ``tlog`` logs, all three together in ``port``;
* ``session``, made of ``port``, ``routing`` (who is told), ``duties`` (what is due), ``hearing`` (how long silent),
  ``operator_stop``, ``search`` of the vehicle among what ``discovery`` sees, ``identity``, ``texts``;
* ``parameters``: ``param_exchange`` (question and answer), ``param_list``, ``param_watch`` (others' hands),
  ``param_value``, ``surely``; ``journal`` and ``loan`` (borrow, verify, give back), ``params_file``;
* ``commands``; ``rates`` fitted by ``bandwidth``, kept by ``rate_keeper``;
* ``telemetry`` with ``stamps``, ``watchdog``, ``recorder``, waited for by ``lookout``;
* ``driver`` keeps commands in force (``overrides``, ``targets``, ``beat``), ``sticks`` sees whether they are,
  ``obedience`` proves it at arming, ``hands`` notices others', ``company`` knows whose, ``latency`` how late all is,
  ``neutral`` that the outputs rest;
* ``mavlink_craft`` (:class:`MavlinkCraft`) on a ``wiring``, put together by :func:`open_craft` (``boarding``).

Adding a transport: a class with ``_read_available``, ``_write``, ``_close``, a line in ``TRANSPORTS``, and its ends in
the conformance suite (``tests/link/link_ends.py``).
"""

from __future__ import annotations

from gcs_autotune.link.boarding import NEEDED_RATES, WANTED_RATES, open_craft
from gcs_autotune.link.commands import Commands
from gcs_autotune.link.fingerprint import difference, fingerprint_of
from gcs_autotune.link.identity import VehicleIdentity
from gcs_autotune.link.journal import Journal, JournalState
from gcs_autotune.link.loan import ParameterLoan
from gcs_autotune.link.mavlink_craft import MavlinkCraft
from gcs_autotune.link.memory import MemoryLink, Peer
from gcs_autotune.link.outputs import read_outputs
from gcs_autotune.link.parameters import Parameters, same_float32
from gcs_autotune.link.params_file import load_params, save_params, save_qgc_params
from gcs_autotune.link.rates import Granted, Rates
from gcs_autotune.link.session import Session
from gcs_autotune.link.signing import SigningKey
from gcs_autotune.link.texts import StatusText
from gcs_autotune.link.tlog import TlogReader, TlogRecord, TlogWriter, read_tlog
from gcs_autotune.link.transport import Transport
from gcs_autotune.link.uri import BACKENDS, TRANSPORTS, open_link
from gcs_autotune.link.wiring import Wiring

__all__ = [
    "BACKENDS",
    "NEEDED_RATES",
    "TRANSPORTS",
    "WANTED_RATES",
    "Commands",
    "Granted",
    "Journal",
    "JournalState",
    "MavlinkCraft",
    "MemoryLink",
    "ParameterLoan",
    "Parameters",
    "Peer",
    "Rates",
    "Session",
    "SigningKey",
    "StatusText",
    "TlogReader",
    "TlogRecord",
    "TlogWriter",
    "Transport",
    "VehicleIdentity",
    "Wiring",
    "difference",
    "fingerprint_of",
    "load_params",
    "open_craft",
    "open_link",
    "read_outputs",
    "read_tlog",
    "same_float32",
    "save_params",
    "save_qgc_params",
]
