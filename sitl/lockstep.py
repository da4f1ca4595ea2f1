"""Connect the vehicle to a pipe, with a clock that waits for the other end (decision record 1).

Each request has one reply. Request: ``<dI`` (time to run to [s], n) and n bytes for the vehicle. Reply: ``<dI`` (time
reached [s], n) and n bytes from the vehicle. The end of the file ends the service.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

from sitl.mavlink import Server

__all__ = ["serve_lockstep"]

_HEAD = struct.Struct("<dI")


def serve_lockstep(server: Server, requests: BinaryIO, replies: BinaryIO) -> None:
    """Answer requests until the other end closes. A request truncated by the end of file is ignored."""
    while True:
        head = requests.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        grant, count = _HEAD.unpack(head)
        data = requests.read(count)
        if len(data) < count:
            return
        server.receive(data)
        sent = server.advance_to(grant)
        replies.write(_HEAD.pack(server.now, len(sent)) + sent)
        replies.flush()
