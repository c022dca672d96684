"""Links that let somebody in once, and the sessions that they are exchanged for.

A session has two secrets: the path that all of its addresses begin with, and a cookie that a browser sends to that path
alone. A browser sends the cookies of a host to all its ports, so that a cookie for `/` would reach whoever listens at
another port of this machine; the path reaches nobody, and without the cookie it opens nothing.
"""

import hmac
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass


def _secret() -> str:
    return secrets.token_urlsafe(32)


@dataclass(frozen=True)
class Session:
    """What one browser must know."""

    path: str
    cookie: str


class Sessions:
    """Of one dashboard, which forgets them when it ends."""

    def __init__(self) -> None:
        """Nobody is let in yet."""
        self._unused: dict[str, Callable[[], None]] = {}
        self._begun: dict[str, Session] = {}

    def invite(self, used: Callable[[], None]) -> str:
        """A new token; `used` is called when a session begins with it."""
        token = _secret()
        self._unused[token] = used
        return token

    def begin(self, token: str) -> Session | None:
        """A session for whoever brings a token that was not used yet; None for others."""
        used = self._unused.pop(token, None)
        if used is None:
            return None
        session = Session(_secret(), _secret())
        self._begun[session.path] = session
        used()
        return session

    def knows(self, path: str, cookies: Iterable[str]) -> bool:
        """Whether one of `cookies` is that of the session at `path`.

        Other ports can have set some of the same name.
        """
        session = self._begun.get(path)
        return session is not None and any(
            hmac.compare_digest(cookie.encode(), session.cookie.encode()) for cookie in cookies
        )
