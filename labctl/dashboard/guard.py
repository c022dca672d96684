"""Who may come in: whoever has the token that was printed, from a page of this very server.

Every request passes here, websockets included, before anything else sees it:

- `Host` must be a name of this server: a name that was made to point at it (DNS rebinding) is refused.
- `Origin`, where a browser says it, must be this server; a websocket must say it. So no other page can act here.
- The token in the address is exchanged for a cookie that is sent to this server alone (`SameSite=Strict`).

Everything else is answered 403 and goes no further.
"""

import hmac
import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)
POLICY = (
    b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    b"img-src 'self' data:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'none'; "
    b"form-action 'none'; frame-ancestors 'none'"
)
"""Nothing from anywhere else. The page's templates are compiled in the browser, hence 'unsafe-eval'."""
ENTRANCE = (
    b"""<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url=/"><title>labctl</title>"""
)
"""Goes on by itself from a page of this server, so that the cookie is sent whatever page led here."""


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address or name."""
    if host in LOOPBACK:
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


class Guard:
    """An ASGI application around another one."""

    def __init__(self, app: App, *, host: str, names: Iterable[str], port: int, token: str) -> None:
        """Let into `app`, which listens at `host` and `port`, whoever has `token`.

        `names` are what this machine is called; they count where `host` is not loopback, and numeric addresses do too.
        """
        self._app = app
        self._token = token.encode()
        self._session = secrets.token_urlsafe(32).encode()
        self._cookie = f"labctl-{port}"  # a browser sends cookies to all ports of a host
        self._port = port
        self._local = is_loopback(host)
        self._names = set(LOOPBACK) if self._local else {*LOOPBACK, host.lower(), *(name.lower() for name in names)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may come in, with headers that ask the browser to be careful; refuse the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        if not self._is_from_here(scope, headers):
            await _refuse(scope, send, b"This address is not the dashboard's: open the one that labctl printed.\n")
        elif self._has_cookie(headers):
            await self._app(scope, receive, _careful(send))
        elif scope["type"] == "http" and scope["method"] == "GET" and self._has_token(scope):
            cookie = f"{self._cookie}={self._session.decode()}; Path=/; HttpOnly; SameSite=Strict"
            await _answer(send, 200, b"text/html; charset=utf-8", ENTRANCE, ((b"set-cookie", cookie.encode()),))
        else:
            await _refuse(scope, send, b"The token is missing or wrong: open the address that labctl printed.\n")

    def _is_from_here(self, scope: Scope, headers: dict[bytes, list[bytes]]) -> bool:
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or len(origins) > 1 or not self._is_own(hosts[0]):
            return False
        if not origins:
            return scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        return origins[0] == b"http://" + hosts[0]

    def _is_own(self, host: bytes) -> bool:
        try:
            parts = urlsplit(f"//{host.decode('ascii')}")
            name, port = parts.hostname or "", parts.port or 80
        except ValueError:
            return False
        if port != self._port or parts.username is not None or parts.path:
            return False
        return name in self._names or (not self._local and _is_numeric(name))

    def _has_cookie(self, headers: dict[bytes, list[bytes]]) -> bool:
        try:
            cookies = SimpleCookie(b"; ".join(headers.get(b"cookie", [])).decode("latin-1"))
        except CookieError:
            return False
        found = cookies.get(self._cookie)
        return found is not None and hmac.compare_digest(found.value.encode("latin-1"), self._session)

    def _has_token(self, scope: Scope) -> bool:
        if scope["path"] != "/":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(given) == 1 and hmac.compare_digest(given[0].encode(), self._token)


def _is_numeric(name: str) -> bool:
    """A number cannot be made to point elsewhere."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _headers(scope: Scope) -> dict[bytes, list[bytes]]:
    found: dict[bytes, list[bytes]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.lower(), []).append(value)
    return found


def _careful(send: Send) -> Send:
    async def sent(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", []))
            own = {name.lower() for name, _ in headers}
            policy = () if b"content-security-policy" in own else ((b"content-security-policy", POLICY),)
            message["headers"] = [*headers, *HEADERS, *policy]
        await send(message)

    return sent


async def _refuse(scope: Scope, send: Send, why: bytes) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})  # before it is accepted: the handshake is answered 403
    else:
        await _answer(send, 403, b"text/plain; charset=utf-8", why)


async def _answer(send: Send, status: int, kind: bytes, body: bytes, more: Iterable[tuple[bytes, bytes]] = ()) -> None:
    headers = [(b"content-type", kind), (b"cache-control", b"no-store"), *HEADERS, *more]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
