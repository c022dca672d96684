"""Who may come in: every way that leads past the token, or from another page, is tried."""

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

from labctl.dashboard.guard import Guard, is_loopback

HERE = {"host": "127.0.0.1:8050"}
TOKEN = "secret"  # noqa: S105


class Inside:
    """What is guarded: it answers whatever gets so far."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"inside"})
        else:
            await send({"type": "websocket.accept"})


@pytest.fixture
def guard() -> Guard:
    return Guard(Inside(), host="127.0.0.1", names=("bench-pc",), port=8050, token=TOKEN)


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


@pytest.fixture
def cookie(guard: Guard) -> str:
    (start, _) = answer(guard, f"/?token={TOKEN}", **HERE)
    headers = dict(start["headers"])
    assert b"SameSite=Strict" in headers[b"set-cookie"]
    assert b"HttpOnly" in headers[b"set-cookie"]
    return str(headers[b"set-cookie"].decode()).partition(";")[0]


def test_the_token_is_exchanged_for_a_cookie_that_opens(guard: Guard, cookie: str) -> None:
    sent = answer(guard, "/run/a", cookie=cookie, **HERE)
    assert status(sent) == 200
    assert b"frame-ancestors 'none'" in dict(sent[0]["headers"])[b"content-security-policy"]
    assert TOKEN not in cookie
    here = HERE | {"origin": "http://127.0.0.1:8050"}
    assert status(answer(guard, "/ws", "websocket", cookie=cookie, **here)) == 101
    assert status(answer(guard, "/ws", method="POST", cookie=cookie, **here)) == 200


@pytest.mark.parametrize(
    "path", ["/", "/?token=", "/?token=wrong", "/?token=secret&token=secret", "/run/a?token=secret", "/_nicegui/x.js"]
)
def test_without_token_or_cookie_nothing_is_there(guard: Guard, path: str) -> None:
    assert status(answer(guard, path, **HERE)) == 403


@pytest.mark.parametrize("value", ["labctl-8050=", "labctl-8050=secret", "labctl-8051={}", "{}x", "\x00=;;", "a=b"])
def test_a_wrong_cookie_opens_nothing(guard: Guard, cookie: str, value: str) -> None:
    given = value.format(cookie.partition("=")[2] if value.startswith("labctl") else cookie)
    assert status(answer(guard, cookie=given, **HERE)) == 403


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
def test_another_host_is_refused_with_cookie_and_with_token(guard: Guard, cookie: str, host: str) -> None:
    assert status(answer(guard, host=host, cookie=cookie)) == 403
    assert status(answer(guard, f"/?token={TOKEN}", host=host)) == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8050", "localhost:8050", "[::1]:8050"])
def test_this_machine_by_all_its_names(guard: Guard, cookie: str, host: str) -> None:
    assert status(answer(guard, host=host, cookie=cookie)) == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1:8050", "http://127.0.0.1:8051", "http://localhost:8050"],
)
@pytest.mark.parametrize(("kind", "method"), [("http", "GET"), ("http", "POST"), ("websocket", "GET")])
def test_another_origin_is_refused(guard: Guard, cookie: str, origin: str, kind: str, method: str) -> None:
    assert status(answer(guard, "/", kind, method, cookie=cookie, origin=origin, **HERE)) == 403


@pytest.mark.parametrize(("kind", "method"), [("http", "POST"), ("websocket", "GET")])
def test_what_can_act_must_name_its_origin(guard: Guard, cookie: str, kind: str, method: str) -> None:
    assert status(answer(guard, "/", kind, method, cookie=cookie, **HERE)) == 403


def test_other_machines_come_by_name_or_number_where_they_may() -> None:
    guard = Guard(Inside(), host="0.0.0.0", names=("Bench-PC",), port=8050, token=TOKEN)  # noqa: S104
    for host, expected in (("bench-pc:8050", 200), ("192.0.2.7:8050", 200), ("evil.example:8050", 403)):
        assert status(answer(guard, f"/?token={TOKEN}", host=host)) == expected


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("127.8.9.1", True), ("localhost", True), ("0.0.0.0", False), ("pc", False)],  # noqa: S104
)
def test_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected
