"""Who may come in: whoever has a session, from a page of this very server.

Every request passes here, websockets included, before anything else sees it:

- `Host` must be a name of this server: a name that was made to point at it (DNS rebinding) is refused.
- `Origin`, where a browser says it, must be this server; a websocket must say it. So no other page can act here, and
  where a browser says what led to a request (`Sec-Fetch-Site`), no other page can show what is here either.
- A token in the address is exchanged, once, for a session: a secret path, and a cookie for that path alone.

Everything else is answered 403 and goes no further.
"""

from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs, urlsplit

from labctl.dashboard.sessions import Session, Sessions

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
COOKIE = "labctl"
ENTRANCE = (
    '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url=/{path}/"><title>labctl</title>'
)
"""Goes on by itself from a page of this server, so that the cookie is sent whatever page led here."""
OWN_SITES = (b"same-origin", b"none")
"""What a browser says of requests by pages of this server, and of addresses that were typed."""


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

    def __init__(self, app: App, *, host: str, names: Iterable[str], port: int, sessions: Sessions) -> None:
        """Let into `app`, which listens at `host` and `port`, whoever has one of `sessions`.

        `names` are what this machine is called; they count where `host` is not loopback, and numeric addresses do too.
        """
        self._app = app
        self._sessions = sessions
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
        elif (root := self._root(scope, headers)) is not None:
            await self._app({**scope, "root_path": root}, receive, _careful(send))
        elif (session := self._begun(scope)) is not None:
            cookie = f"{COOKIE}={session.cookie}; Path=/{session.path}/; HttpOnly; SameSite=Strict".encode()
            page = ENTRANCE.format(path=session.path).encode()
            await _answer(send, 200, b"text/html; charset=utf-8", page, ((b"set-cookie", cookie),))
        else:
            await _refuse(scope, send, b"Nobody is let in here without a link from labctl; each link works once.\n")

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

    def _root(self, scope: Scope, headers: dict[bytes, list[bytes]]) -> str | None:
        """The path of the session that a request belongs to, with its slash; None if it belongs to none."""
        secret, slash, _ = scope["path"].removeprefix("/").partition("/")
        own = all(site in OWN_SITES for site in headers.get(b"sec-fetch-site", []))
        known = self._sessions.knows(secret, _cookies(headers))
        return f"/{secret}" if slash and own and known else None

    def _begun(self, scope: Scope) -> Session | None:
        """The session that begins with the token in an address; None if there is no token or it was used."""
        if scope["type"] != "http" or scope["method"] != "GET" or scope["path"] != "/":
            return None
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return self._sessions.begin(given[0]) if len(given) == 1 else None


def _cookies(headers: dict[bytes, list[bytes]]) -> list[str]:
    pairs = (
        pair.strip().partition("=") for line in headers.get(b"cookie", []) for pair in line.decode("latin-1").split(";")
    )
    return [value for name, _, value in pairs if name == COOKIE]


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
    headers = [(b"content-type", kind), (b"cache-control", b"no-store"), (b"connection", b"close"), *HEADERS, *more]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
