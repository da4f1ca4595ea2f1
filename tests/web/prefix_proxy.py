"""A reverse proxy that shows a server under a path prefix, as BlueOS does: it strips the prefix."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from socketserver import StreamRequestHandler, ThreadingTCPServer
from urllib.parse import urlsplit


@contextmanager
def behind(link: str, prefix: str) -> Iterator[str]:
    """Yield the link under which the server at *link* is seen behind *prefix* (``/with/slashes``); then all is cut."""
    at = urlsplit(link)
    under_way: set[socket.socket] = set()

    class Passing(StreamRequestHandler):
        def handle(self) -> None:
            with suppress(OSError), socket.create_connection((str(at.hostname), int(at.port or 80))) as upstream:
                head = self._head(prefix)
                if head:
                    under_way.add(upstream)
                    upstream.sendall(head)
                    onward = threading.Thread(target=_pump, args=(self.rfile.read1, upstream))
                    onward.start()
                    _pump(upstream.recv, self.connection)
                    self.connection.shutdown(socket.SHUT_RDWR)
                    onward.join()
                under_way.discard(upstream)

        def _head(self, prefix: str) -> bytes:
            """Read one request's head and return it as it goes on: one request a connection, or a WebSocket."""
            lines = [line.rstrip(b"\r\n").decode("latin-1") for line in iter(self.rfile.readline, b"\r\n") if line]
            method, path, version = lines[0].split(" ")
            if not path.startswith(f"{prefix}/"):
                self.wfile.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                return b""
            fields = lines[1:]
            if not any(field.lower().startswith("upgrade:") for field in fields):
                fields = [field for field in fields if not field.lower().startswith("connection:")]
                fields.append("Connection: close")
            line = f"{method} {path.removeprefix(prefix)} {version}"
            return "\r\n".join([line, *fields, "", ""]).encode("latin-1")

    class Server(ThreadingTCPServer):
        allow_reuse_address, daemon_threads = True, True

    with Server(("127.0.0.1", 0), Passing) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}{prefix}/"
        server.shutdown()
        thread.join()
        for upstream in tuple(under_way):
            with suppress(OSError):
                upstream.shutdown(socket.SHUT_RDWR)


def _pump(read: object, sink: socket.socket) -> None:
    with suppress(OSError, ValueError):  # ValueError: the file of a connection that the other side has closed
        while piece := read(65536):  # type: ignore[operator]
            sink.sendall(piece)
