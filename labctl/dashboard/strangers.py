"""Connections on which nobody has shown a session yet: few, and not for long.

A half request, or a connection that says nothing, would otherwise be kept until its client ends it.
"""

import asyncio
from collections.abc import MutableMapping
from functools import partial
from typing import Any, cast

from uvicorn.protocols.http.h11_impl import H11Protocol

from labctl.dashboard.guard import App, Receive, Send

MOST = 64
LONGEST_S = 10.0
_RECOGNISED = "labctl.recognised"


class Strangers:
    """One server's: the oldest gives way to one too many, so that they keep nobody else out."""

    def __init__(self, most: int = MOST, longest_s: float = LONGEST_S) -> None:
        """At most `most` of them, each for `longest_s` seconds."""
        self._most = most
        self._longest_s = longest_s
        self._waiting: dict[asyncio.Transport, asyncio.TimerHandle] = {}

    def protocol(self, *, app_state: dict[str, Any], **given: Any) -> asyncio.Protocol:
        """Of a new connection, from what uvicorn gives to one. h11 refuses a header that 16 KiB do not end."""
        return _Arrival(self, app_state, given)

    def came(self, transport: asyncio.Transport) -> None:
        """Somebody has connected."""
        if len(self._waiting) >= self._most:
            self._drop(next(iter(self._waiting)))
        later = asyncio.get_running_loop().call_later
        self._waiting[transport] = later(self._longest_s, self._drop, transport)

    def recognised(self, transport: asyncio.Transport) -> None:
        """Whoever it is has shown a session."""
        timer = self._waiting.pop(transport, None)
        if timer is not None:
            timer.cancel()

    def _drop(self, transport: asyncio.Transport) -> None:
        self.recognised(transport)
        transport.abort()


class _Arrival(asyncio.Protocol):
    """Counts a connection and leaves it to uvicorn."""

    def __init__(self, strangers: Strangers, app_state: dict[str, Any], given: dict[str, Any]) -> None:
        self._strangers = strangers
        self._app_state = app_state
        self._given = given

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        link = cast(asyncio.Transport, transport)
        self._strangers.came(link)
        state = self._app_state | {_RECOGNISED: partial(self._strangers.recognised, link)}
        served = H11Protocol(app_state=state, **self._given)
        link.set_protocol(served)
        served.connection_made(link)


def recognising(app: App) -> App:
    """Around an application that only those reach who have a session: their connections may stay."""

    async def called(scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            scope["state"][_RECOGNISED]()
        await app(scope, receive, send)

    return called
