"""The other side of decision 1 in its smallest form: an echo that keeps time. Some words have effects."""

from __future__ import annotations

import signal
import struct
import sys

HEAD = struct.Struct("<dI")


def main() -> None:
    if "--unknown" in sys.argv:
        sys.exit(complain("sitl: unknown vehicle 'charly'. Did you mean charlie or charles? Known: ...", 2))
    stubborn = "--stubborn" in sys.argv
    if stubborn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    now, grants = 0.0, []
    while head := sys.stdin.buffer.read(HEAD.size):
        grant, count = HEAD.unpack(head)
        data = sys.stdin.buffer.read(count)
        if data == b"crash":
            sys.exit(complain("hull breached", 1))
        if data == b"hang":
            signal.pause()
        if data == b"grants":
            grants.clear()
            data = b""
        elif data == b"tell":
            data = f"first {grants[0]:.2f}, longest {max(grants):.2f}".encode()
        grants.append(grant - now)
        now = max(now, grant)
        sys.stdout.buffer.write(HEAD.pack(now, len(data)) + data)
        sys.stdout.buffer.flush()
    while stubborn:
        signal.pause()


def complain(text: str, code: int) -> int:
    sys.stderr.write(text + "\n")
    return code


if __name__ == "__main__":
    main()
