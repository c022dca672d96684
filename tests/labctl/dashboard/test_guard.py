"""Who may come in: every way that leads past the token, or from another page, is tried."""

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

from labctl.dashboard.guard import Guard, is_loopback
from labctl.dashboard.sessions import Sessions

HERE = {"host": "127.0.0.1:8050"}


class Inside:
    """What is guarded: it answers whatever gets so far."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"inside"})
        else:
            await send({"type": "websocket.accept"})


@pytest.fixture
def sessions() -> Sessions:
    return Sessions()


@pytest.fixture
def guard(sessions: Sessions) -> Guard:
    return Guard(Inside(), host="127.0.0.1", names=("bench-pc",), port=8050, sessions=sessions)


def answer(
    guard: Guard, path: str = "/", kind: str = "http", method: str = "GET", **headers: str
) -> list[MutableMapping[str, Any]]:
    path, _, query = path.partition("?")
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    sent: list[MutableMapping[str, Any]] = []

    async def receive() -> MutableMapping[str, Any]:
        raise AssertionError

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    asyncio.run(guard(scope, receive, send))
    return sent


def status(sent: list[MutableMapping[str, Any]]) -> int:
    if sent[0]["type"].startswith("websocket"):
        return 101 if sent[0]["type"] == "websocket.accept" else 403
    return int(sent[0]["status"])


def begin(guard: Guard, sessions: Sessions) -> tuple[str, str]:
    """Path of a new session, and the cookie for it."""
    token = sessions.invite(lambda: None)
    (start, body) = answer(guard, f"/?token={token}", **HERE)
    cookie, path, *rest = dict(start["headers"])[b"set-cookie"].decode().split("; ")
    assert rest == ["HttpOnly", "SameSite=Strict"]
    path = path.removeprefix("Path=")
    assert f"url={path}".encode() in body["body"]
    assert token not in cookie + path
    return path, cookie


@pytest.fixture
def session(guard: Guard, sessions: Sessions) -> tuple[str, str]:
    return begin(guard, sessions)


@pytest.fixture
def path(session: tuple[str, str]) -> str:
    return session[0]


@pytest.fixture
def cookie(session: tuple[str, str]) -> str:
    return session[1]


def test_a_session_opens_everything_below_its_path(guard: Guard, path: str, cookie: str) -> None:
    sent = answer(guard, f"{path}run/a", cookie=cookie, **HERE)
    assert status(sent) == 200
    assert b"frame-ancestors 'none'" in dict(sent[0]["headers"])[b"content-security-policy"]
    here = HERE | {"origin": "http://127.0.0.1:8050"}
    assert status(answer(guard, f"{path}ws", "websocket", cookie=cookie, **here)) == 101
    assert status(answer(guard, f"{path}ws", method="POST", cookie=cookie, **here)) == 200


def test_a_token_works_once_and_tells_that_it_was_used(guard: Guard, sessions: Sessions) -> None:
    used: list[str] = []
    token = sessions.invite(lambda: used.append("used"))
    assert status(answer(guard, f"/?token={token}", method="POST", origin="http://127.0.0.1:8050", **HERE)) == 403
    assert status(answer(guard, f"/?token={token}", host="evil.example:8050")) == 403
    assert used == [], "a refused request uses nothing up"
    assert status(answer(guard, f"/?token={token}", **HERE)) == 200
    assert used == ["used"]
    assert status(answer(guard, f"/?token={token}", **HERE)) == 403


@pytest.mark.parametrize(
    "address", ["/", "/?token=", "/?token=wrong", "/?token={0}&token={0}", "/run/a?token={0}", "/_nicegui/x.js"]
)
def test_without_token_or_session_nothing_is_there(guard: Guard, sessions: Sessions, address: str) -> None:
    assert status(answer(guard, address.format(sessions.invite(lambda: None)), **HERE)) == 403


@pytest.mark.parametrize(
    "value", ["labctl=", "other={0}", "labctl={0}x", "\x00=;;", "a=b", "labctl", "labctl=\xe9", ""]
)
def test_a_wrong_cookie_opens_nothing(guard: Guard, path: str, cookie: str, value: str) -> None:
    assert status(answer(guard, path, cookie=value.format(cookie.partition("=")[2]), **HERE)) == 403


def test_a_cookie_opens_its_own_path_alone(guard: Guard, sessions: Sessions, path: str, cookie: str) -> None:
    other, _ = begin(guard, sessions)
    for address in ("/", "/run/a", other, path.rstrip("/"), f"/x{path}", f"/{path}", path.upper(), f"{other}..{path}"):
        assert status(answer(guard, address, cookie=cookie, **HERE)) == 403


def test_cookies_that_another_port_has_set_shut_nobody_out(guard: Guard, path: str, cookie: str) -> None:
    for held in (f"labctl=x; {cookie}", f"{cookie}; labctl=x", f"a,b=[; {cookie}"):
        assert status(answer(guard, path, cookie=held, **HERE)) == 200


@pytest.mark.parametrize(
    ("site", "expected"), [("same-origin", 200), ("none", 200), ("same-site", 403), ("cross-site", 403)]
)
def test_what_another_page_led_to_is_not_shown(guard: Guard, path: str, cookie: str, site: str, expected: int) -> None:
    """Another port of the same address is the same site: a browser sends it the cookie."""
    assert status(answer(guard, path, cookie=cookie, **HERE, **{"sec-fetch-site": site})) == expected


@pytest.mark.parametrize(
    "host",
    [
        "evil.example:8050",
        "127.0.0.1:8051",
        "127.0.0.1",
        "bench-pc:8050",
        "192.0.2.7:8050",
        "a@127.0.0.1:8050",
        "x:y:z",
        "",
    ],
)
def test_another_host_is_refused_with_session_and_with_token(
    guard: Guard, sessions: Sessions, path: str, cookie: str, host: str
) -> None:
    assert status(answer(guard, path, host=host, cookie=cookie)) == 403
    assert status(answer(guard, f"/?token={sessions.invite(lambda: None)}", host=host)) == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8050", "localhost:8050", "[::1]:8050"])
def test_this_machine_by_all_its_names(guard: Guard, path: str, cookie: str, host: str) -> None:
    assert status(answer(guard, path, host=host, cookie=cookie)) == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1:8050", "http://127.0.0.1:8051", "http://localhost:8050"],
)
@pytest.mark.parametrize(("kind", "method"), [("http", "GET"), ("http", "POST"), ("websocket", "GET")])
def test_another_origin_is_refused(guard: Guard, path: str, cookie: str, origin: str, kind: str, method: str) -> None:
    assert status(answer(guard, path, kind, method, cookie=cookie, origin=origin, **HERE)) == 403


@pytest.mark.parametrize(("kind", "method"), [("http", "POST"), ("websocket", "GET")])
def test_what_can_act_must_name_its_origin(guard: Guard, path: str, cookie: str, kind: str, method: str) -> None:
    assert status(answer(guard, path, kind, method, cookie=cookie, **HERE)) == 403


def test_other_machines_come_by_name_or_number_where_they_may(sessions: Sessions) -> None:
    guard = Guard(Inside(), host="0.0.0.0", names=("Bench-PC",), port=8050, sessions=sessions)  # noqa: S104
    for host, expected in (("bench-pc:8050", 200), ("192.0.2.7:8050", 200), ("evil.example:8050", 403)):
        assert status(answer(guard, f"/?token={sessions.invite(lambda: None)}", host=host)) == expected


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("127.8.9.1", True), ("localhost", True), ("0.0.0.0", False), ("pc", False)],  # noqa: S104
)
def test_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
