"""Who may talk to the page: this machine, this browser, with the token of the address."""

from __future__ import annotations

import hmac
import time
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a page may load and run: files of this server, no script in the page itself."""

HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"), (b"cache-control", b"no-store"),
)  # fmt: skip

RATE, BURST = 150.0, 400.0
"""Questions a second that a window may ask, and how many at once."""

LONGEST = 256 * 1024
"""Bytes of a question."""


class Guard:
    """Refuses what does not come from the page itself, of http and websocket alike.

    Args:
        app: what it guards. port: of the server. token: of the address.
    """

    def __init__(self, app: App, port: int, token: str) -> None:
        self.app, self.token = app, token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.cookie = f"slipctl{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse with 400 (host), 403 (origin, token) or 405 (method)."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        status = self.refusal(scope)
        if status:
            await _refuse(scope, send, status)
            return

        async def sent(message: Any) -> None:
            if message["type"] == "http.response.start":
                message = message | {"headers": [*message.get("headers", []), *HEADERS]}
            await send(message)

        await self.app(scope, receive, sent if scope["type"] == "http" else send)

    def refusal(self, scope: Scope) -> int:
        """Status by which a request is refused; 0 where it may pass."""
        headers: dict[str, list[str]] = {}
        for name, value in scope.get("headers", []):
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        host = headers.get("host", [])
        if len(host) != 1 or host[0] not in self.hosts:
            return 400
        origin = headers.get("origin", [])
        own = f"http://{host[0]}"
        socket = scope["type"] == "websocket"
        if (socket and len(origin) != 1) or any(o != own for o in origin):
            return 403
        if not socket and scope["method"] not in ("GET", "HEAD"):
            return 405
        return 0 if self.knows(scope, headers.get("cookie", [])) else 403

    def knows(self, scope: Scope, cookies: list[str]) -> bool:
        """Whether the token stands in the address or in the cookie."""
        try:
            asked = parse_qs(scope.get("query_string", b"").decode("latin-1"), max_num_fields=8)
            given = asked.get("token", [])
            for text in cookies:
                jar: SimpleCookie = SimpleCookie(text)
                given += [jar[self.cookie].value] if self.cookie in jar else []
        except (ValueError, CookieError):
            return False
        mine = self.token.encode()
        return any(hmac.compare_digest(g.encode("utf-8", "replace"), mine) for g in given)


async def _refuse(scope: Scope, send: Send, status: int) -> None:
    if scope["type"] == "websocket":  # before it is accepted: the handshake is answered by 403
        await send({"type": "websocket.close", "code": 1008, "reason": ""})
        return
    words = {400: "another host", 403: "open the address that slipctl open printed",
             405: "only GET"}[status]  # fmt: skip
    body = f"refused: {words}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


class Bucket:
    """How many questions a window has left: :data:`BURST` at once, :data:`RATE` a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock, self.left, self.at = clock, BURST, clock()

    def take(self) -> bool:
        """Whether one more may be asked."""
        now = self.clock()
        self.left = min(BURST, self.left + RATE * (now - self.at))
        self.at = now
        if self.left < 1:
            return False
        self.left -= 1
        return True
