"""Access control: host names, origins, the token, and the headers of every response.

A foreign page can make a visitor's browser send requests here, through DNS rebinding or a cross-site form or WebSocket.
Therefore the ``Host`` must be a name that no third party can own. The same applies to an ``Origin``.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Mapping
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs_autotune_files import shown

__all__ = ["JOYSTICK_STOP", "TOKEN_HEADER", "Access", "AccessMiddleware", "is_loopback"]

TOKEN_HEADER = "x-autotune-token"
"""Header with the token. A page of another origin cannot set it without a preflight request, which is not answered."""
JOYSTICK_STOP = "joystick-stop"
"""Last segment of the address for a joystick's STOP. It is the only address with its own key, which is valid only for
STOP.
"""
WRONG, WITHIN = 10, 60.0
"""Number of wrong tokens from one address, within this time [s], after which further tokens are ignored.
Project choice.
"""
_ADDRESSES = 1000
AT_ONCE, ALL_AT_ONCE = 48, 128
"""Largest number of simultaneous requests and viewers without the token, per address and in total. Project choice.

A STOP and requests with the token are not counted. The number per address is large because behind BlueOS all requests
come from one address.
"""
_STOPS = ("stop", JOYSTICK_STOP)
_SAFE = ("GET", "HEAD")

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response that does not set its own."""


def is_loopback(host: str) -> bool:
    """Return whether *host* can be reached only from this computer."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


class Access:
    """Authorisation of requests.

    token : required for everything except viewing; empty if only this computer can reach the port.
    hosts : accepted host names in addition to addresses, ``localhost`` and ``*.local``.
    stop_key : key of a joystick's STOP; empty if none is offered.
    """

    def __init__(
        self,
        token: str = "",
        hosts: Iterable[str] = (),
        now: Callable[[], float] = time.monotonic,
        stop_key: str = "",
    ) -> None:
        self.token = token
        self.stop_key = stop_key
        self.seat = self.new_token() if token else ""
        self._hosts = {host.lower() for host in hosts}
        self._now = now
        self._wrong: OrderedDict[str, list[float]] = OrderedDict()

    @staticmethod
    def new_token() -> str:
        """Return a token of 128 random bits."""
        return secrets.token_urlsafe(16)

    def may_sit(self, key: str) -> bool:
        """Return whether *key* is valid for an operator's seat.

        It is issued to a holder of the token and permits nothing else.
        """
        return bool(self.seat) and hmac.compare_digest(key.encode(errors="replace"), self.seat.encode())

    def may_stop(self, key: str) -> bool:
        """Return whether *key* is the key for STOP. It is False if no such key is offered."""
        return bool(self.stop_key) and hmac.compare_digest(key.encode(errors="replace"), self.stop_key.encode())

    def trouble_with_host(self, headers: Headers, *, origin_too: bool = True) -> str:
        """Return why the headers ``Host`` and ``Origin`` are not accepted; empty if they are."""
        host = headers.get("host", "")
        if not self._is_ours(_name_of(f"//{host}")):
            return (
                f"{shown(host, 100)} is not a known name of this server. Start the server with --allow-host to accept "
                "it"
            )
        return self._trouble_with_origin(host, headers) if origin_too else ""

    def _trouble_with_origin(self, host: str, headers: Headers) -> str:
        origin = headers.get("origin")
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return "request from another page rejected. Use this server's own page"
        if origin is not None and not (_netloc_of(origin) == host or _name_of(origin) in self._hosts):
            return f"request from a page of {shown(origin, 100)} rejected. Use this server's own page"
        return ""

    def _is_ours(self, name: str) -> bool:
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name == "localhost" or name.endswith(".local") or name in self._hosts
        return True

    def has_token(self, headers: Headers) -> bool:
        """Return whether the request contains the right token, or no token is required."""
        token = headers.get(TOKEN_HEADER, "")
        return bool(self.token and token) and hmac.compare_digest(token.encode(errors="replace"), self.token.encode())

    def refusal(self, headers: Headers, address: str) -> tuple[int, str] | None:
        """Return HTTP status and reason if a request with *headers* from *address* is not authorised; else None.

        The right token is always accepted, so that guesses by others cannot block its owner's STOP. Its 128 bits cannot
        be guessed. Wrong tokens are counted.
        """
        if not self.token:
            return None
        token = headers.get(TOKEN_HEADER, "")
        if self.has_token(headers):
            return None
        if not token:
            return 401, "view only. To control runs, open the link with the token that the server showed at its start"
        wrong = self._wrong.setdefault(address, [])
        now = self._now()
        wrong[:] = [t for t in wrong if now - t < WITHIN][-WRONG:]
        if len(wrong) >= WRONG:
            return 429, f"too many wrong tokens from {address}. Wait a minute"
        wrong.append(now)
        while len(self._wrong) > _ADDRESSES:
            self._wrong.popitem(last=False)
        return 403, "wrong token. The server creates a new token at every start. Open the link that it shows"


def _name_of(url: str) -> str:
    try:
        return (urlsplit(url).hostname or "").lower()
    except ValueError:
        return ""


def _netloc_of(url: str) -> str:
    try:
        return urlsplit(url).netloc
    except ValueError:
        return ""


class AccessMiddleware:
    """ASGI middleware that rejects foreign hosts and overload, authorises by token, and sets the headers."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access
        self._busy: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer the request or pass it on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refused = self._refused(scope, headers)
        if refused is None:
            await self._count(scope, headers, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": refused[1][:120]})
        else:
            await JSONResponse({"error": refused[1]}, refused[0])(scope, receive, _with_headers(send))

    async def _count(self, scope: Scope, headers: Headers, receive: Receive, send: Send) -> None:
        """Pass the request on unless too many are in progress, from its address or in total. A STOP always passes."""
        sending = send if scope["type"] == "websocket" else _with_headers(send)
        stop = scope["type"] == "http" and scope["method"] == "POST" and scope["path"].rpartition("/")[2] in _STOPS
        if stop or self._access.has_token(headers):
            await self._app(scope, receive, sending)
            return
        address = _address_of(scope)
        if self._busy[address] >= AT_ONCE or self._busy.total() >= ALL_AT_ONCE:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1013, "reason": "too many viewers"})
            else:
                await JSONResponse({"error": "too many requests. Try again in a moment"}, 503)(scope, receive, sending)
            return
        self._busy[address] += 1
        try:
            await self._app(scope, receive, sending)
        finally:
            self._busy[address] -= 1
            if not self._busy[address]:
                del self._busy[address]

    def _refused(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        keyed = scope["type"] == "http" and scope["method"] == "POST" and scope["path"].endswith(f"/{JOYSTICK_STOP}")
        trouble = self._access.trouble_with_host(headers, origin_too=not keyed)
        if trouble:
            return 403, trouble
        if keyed:
            return None  # its handler looks at the key
        if scope["type"] == "websocket" or scope["method"] in _SAFE:
            return None
        if TOKEN_HEADER not in headers:
            return 401 if self._access.token else 403, (
                "the request is not from this server's page. Open the page's link again"
            )
        return self._access.refusal(headers, _address_of(scope))


def _address_of(scope: Scope) -> str:
    return str((scope.get("client") or ("nobody", 0))[0])


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers: Any = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sending
