"""Checks of every request, and the headers of every answer: pages from elsewhere cannot use the server.

A page on the internet can have its own name resolved to 127.0.0.1 (DNS rebinding), and can send requests to
any address. So the name in `Host` must be one of this server's, and `Origin`, which browsers add to every
request that another page makes, must be this server.
"""

import base64
import hashlib
import re
from collections.abc import Iterable
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

LOOPBACK: Final = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine that no other machine can be reached by."""

_IMPORT_MAP: Final = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)


def policy_of(page: str) -> str:
    """Content security policy of a page: everything is this server's, and its import map is as it is.

    Args:
        page: The page's HTML.
    """
    digests = [
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in _IMPORT_MAP.findall(page)
    ]
    return "; ".join(
        [
            "default-src 'none'",
            " ".join(["script-src 'self'", *digests]),
            "style-src 'self'",
            "img-src 'self' data: blob:",
            "media-src 'self' blob:",
            "connect-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


class Guard:
    """Refuses requests of other pages, and adds security headers to every answer.

    Args:
        app: The application behind it.
        names: Host names and addresses of the server.
        policy: Content security policy.
    """

    def __init__(self, app: ASGIApp, *, names: Iterable[str], policy: str) -> None:
        self.app, self.names = app, frozenset(name.lower() for name in names)
        self.headers = {
            "content-security-policy": policy,
            "x-content-type-options": "nosniff",
            "referrer-policy": "no-referrer",
            "cross-origin-opener-policy": "same-origin",
            "cross-origin-resource-policy": "same-origin",
            "permissions-policy": "camera=(self), microphone=(), geolocation=()",
            "cache-control": "no-store",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check a request, and pass it on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self.refusal(Headers(scope=scope))
        if refusal is None:
            await self.app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await WebSocketClose(code=1008, reason=refusal[:120])(scope, receive, send)
        else:
            answer = JSONResponse({"error": refusal}, status_code=403)
            await answer(scope, receive, self._with_headers(send))

    def refusal(self, headers: Headers) -> str | None:
        """Reason why a request is refused; None if it is not.

        Args:
            headers: Headers of the request.
        """
        host = headers.get("host", "")
        if _name_of(f"//{host}") not in self.names:
            return (
                f"The request is for the host {host[:60]!r}; expected {', '.join(sorted(self.names))}. Open "
                "the address that the command shows, or start it with names=[<name>]."
            )
        origin = headers.get("origin")
        if origin is not None and _place_of(origin) != host.lower():
            return (
                f"The request comes from the page {origin[:60]!r}; expected this page alone. Open the "
                "address that the command shows."
            )
        return None

    def _with_headers(self, send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self.headers.items():
                    headers[name] = value
            await send(message)

        return sending


def _name_of(address: str) -> str:
    """Name or number of the host of an address, lower case; empty if it has none, or a user before it."""
    place = _place_of(address)
    return "" if "@" in place else (urlsplit(f"//{place}").hostname or "").lower()


def _place_of(address: str) -> str:
    """Host and port of an address, lower case; empty if it is no address."""
    try:
        return urlsplit(address).netloc.lower()
    except ValueError:
        return ""
