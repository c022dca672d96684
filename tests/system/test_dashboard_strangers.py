"""Who has no browser that was let in: another user of this machine, and connections that ask for nothing whole."""

import os
import re
import select
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext, suppress
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="the dashboard is started beside what drives a browser")

from tests.dashboard.browser import Dashboard, dashboard
from tests.system.waiting import until

NOBODY = 65534
PROGRAMS = ("curl", "setpriv", "ps")
SOCKET_IO = "_nicegui_ws/socket.io/?EIO=4&transport=websocket"
CONNECTIONS = 200
WAITING = 64
"""So many connections without a session are kept."""
PATIENCE_S = 60.0
SMALL = 16 << 20

pytestmark = pytest.mark.usefixtures("started_anew")
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dashboard]:
    with dashboard(tmp_path_factory.mktemp("runs")) as found:
        yield found


@pytest.fixture(scope="module")
def nobody() -> Callable[..., str]:
    """A command as another user of this machine; what it prints."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root can be another user")
    if missing := [name for name in PROGRAMS if shutil.which(name) is None]:
        pytest.skip(f"{', '.join(missing)}: not installed")

    def run(*words: str) -> str:
        other = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", *words)
        ended = subprocess.run(other, capture_output=True, check=False, cwd="/", stdin=subprocess.DEVNULL)
        return ended.stdout.decode(errors="replace")

    assert run("sh", "-c", "id -u").strip() == str(NOBODY)
    return run


@pytest.fixture
def curl(nobody: Callable[..., str]) -> Callable[..., str]:
    """Status of an answer to another user; 000 where there was none."""

    def status(address: str, *options: str) -> str:
        return nobody(
            "curl", "--silent", "--max-time", "30", "--output", "/dev/null", *options, "-w", "%{http_code}", address
        )

    return status


@pytest.fixture(scope="module")
def session(shown: Dashboard) -> tuple[str, str]:
    """Address and cookie of somebody who was let in, with a link that is used now."""
    cookie, path, *_ = asked(shown, next(shown.links)).headers["set-cookie"].split("; ")
    return f"{shown.base}{path.removeprefix('Path=')}", cookie


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/?token=",
        "/?token=" + "A" * 43,
        "/?token[]=x",
        "/run/x",
        "/report/x",
        "//",
        "/../",
        "/%2e%2e/",
        f"/{SOCKET_IO}",
    ],
)
def test_another_user_without_a_token_sees_nothing(shown: Dashboard, curl: Callable[..., str], path: str) -> None:
    assert curl(f"{shown.base}{path}", "--path-as-is") == "403"
    assert curl(f"{shown.base}{path}", "--path-as-is", "--data", "x=1", "--header", f"Origin: {shown.base}") == "403"


def test_half_of_what_a_session_knows_opens_nothing(
    shown: Dashboard, session: tuple[str, str], curl: Callable[..., str]
) -> None:
    """The address from a history or over a shoulder; the cookie from a request to another port."""
    address, cookie = session
    assert curl(address, "--cookie", cookie) == "200", "both open it: this is what must not be known"
    assert curl(address) == "403"
    for path in ("/", "/run/x", f"/{SOCKET_IO}", "/labctl/"):
        assert curl(f"{shown.base}{path}", "--cookie", cookie) == "403"


def test_a_link_is_of_no_use_when_it_was_used(shown: Dashboard, curl: Callable[..., str]) -> None:
    link = next(shown.links)
    assert curl(link) == "200"
    assert curl(link) == "403"
    later = next(shown.links)
    assert later != link
    assert curl(later, "--request", "POST", "--header", f"Origin: {shown.base}") == "403"
    assert curl(later, "--head") == "403"
    assert curl(later, "--header", "Host: evil.example") == "403"
    assert curl(later) == "200", "what was refused has not used it up"


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (("Origin: {base}",), b"101"),
        (("Origin: http://evil.example",), b"403"),
        (("Origin: null",), b"403"),
        ((), b"403"),
        (("Origin: {base}", "Sec-Fetch-Site: same-site"), b"403"),
        (("Origin: {base}", "Host: evil.example:{port}"), b"403"),
    ],
)
def test_a_page_elsewhere_opens_no_websocket_though_it_knows_everything(
    shown: Dashboard, session: tuple[str, str], more: tuple[str, ...], expected: bytes
) -> None:
    address, cookie = session
    lines = [
        f"GET {address.removeprefix(shown.base)}{SOCKET_IO} HTTP/1.1",
        *([] if any(line.startswith("Host") for line in more) else [f"Host: 127.0.0.1:{shown.port}"]),
        f"Cookie: {cookie}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        *(line.format(base=shown.base, port=shown.port) for line in more),
    ]
    with socket.create_connection(("127.0.0.1", shown.port), timeout=PATIENCE_S) as link, link.makefile("rb") as answer:
        link.sendall("\r\n".join([*lines, "\r\n"]).encode())
        assert answer.readline().split()[1] == expected


@linux
def test_no_process_tells_another_user_a_link(nobody: Callable[..., str], tmp_path: Path) -> None:
    """The browser is opened at a file that only its owner can read; it is looked for where everybody can look."""
    with tempfile.TemporaryDirectory() as home:
        os.chmod(home, 0o755)  # noqa: S103  # the file must keep itself
        told = Path(home) / "told"
        program = Path(home) / "browser"
        program.write_text(f'#!/bin/sh\necho "$@" > {told}.new; mv {told}.new {told}; sleep 1000\n', encoding="utf-8")
        program.chmod(0o755)
        runs = tmp_path / "runs"
        runs.mkdir()
        with dashboard(runs, {"HOME": home, "BROWSER": f"{program} %s"}) as found:
            until(told.exists)
            browser = descendants(found.process)
            assert browser
            page = Path(told.read_text("utf-8").strip().removeprefix("file://"))
            printed, hidden = next(found.links), link_in(page)
            assert printed != hidden
            assert page.stat().st_mode & 0o777 == 0o600
            assert page.parent.stat().st_mode & 0o777 == 0o700
            files = [f"/proc/{process}/{name}" for process in (found.process, *browser) for name in ("environ", "fd/*")]
            seen = nobody("sh", "-c", f"cat /proc/[0-9]*/cmdline {' '.join(files)} {page} {page.parent}/*")
            assert str(page) in seen, "everybody reads the command line"
            for link in (printed, hidden):
                assert link.partition("token=")[2] not in seen
            assert "token=" not in nobody("ps", "-eo", "args")
            for process in (found.process, *browser):
                for name in ("cmdline", "environ"):
                    ended = suppress(FileNotFoundError, ProcessLookupError) if process in browser else nullcontext()
                    with ended:
                        assert b"token=" not in Path(f"/proc/{process}/{name}").read_bytes(), "not even to its owner"
            assert asked(found, hidden).status == 200
            assert not page.parent.exists(), "what was used is removed"
            for process in browser:
                with suppress(ProcessLookupError):
                    os.kill(process, 9)


def test_what_nobody_used_is_removed_with_the_dashboard(tmp_path: Path) -> None:
    home, runs = tmp_path / "home", tmp_path / "runs"
    home.mkdir()
    runs.mkdir()
    with dashboard(runs, {"HOME": str(home), "BROWSER": "true"}):
        until(lambda: bool(list(home.glob("labctl-*/open.html"))))
    assert list(home.iterdir()) == []


def test_where_no_file_can_be_written_the_printed_link_is_left(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    with dashboard(runs, {"HOME": str(tmp_path / "nowhere"), "BROWSER": "true"}) as found:
        assert "/?token=" in next(found.links)


@linux
def test_an_endless_header_takes_no_memory(shown: Dashboard) -> None:
    before = peak(shown.process)
    for beginning, piece in (
        (b"GET / HTTP/1.1\r\nHost: a\r\n", b"x: " + b"y" * 1000 + b"\r\n"),
        (b"GET / HTTP/1.1\r\nx: ", b"y" * 1000),
        (b"GET /", b"y" * 1000),
        (b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 1000000000000\r\n\r\n", b"y" * 1000),
        (b"POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n", b"3e8\r\n" + b"y" * 1000 + b"\r\n"),
    ):
        with socket.create_connection(("127.0.0.1", shown.port), timeout=PATIENCE_S) as link:
            link.sendall(beginning)
            assert sent_until_dropped(link, piece) < SMALL, beginning
    assert peak(shown.process) - before < SMALL


def test_half_requests_are_dropped(shown: Dashboard) -> None:
    """Also those that go on a byte at a time, and a connection that was answered."""
    address = ("127.0.0.1", shown.port)
    beginnings = (
        b"",
        b"G",
        b"GET / HTTP/1.1\r\nHost: a",
        b"POST / HTTP/1.1\r\nContent-Length: 10\r\n\r\nhalf",
        b"GET / HTTP/1.1\r\n\r\nGET / HT",
        b"GET / HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n",
    )
    with ExitStack() as stack:
        links = [stack.enter_context(socket.create_connection(address, timeout=PATIENCE_S)) for _ in beginnings]
        slow = stack.enter_context(socket.create_connection(address, timeout=PATIENCE_S))
        for link, beginning in zip(links, beginnings, strict=True):
            link.sendall(beginning)
        assert sent_until_dropped(slow, b"x", pause_s=0.2) < 1000
        for link in (*links, slow):
            assert_dropped(link)


@linux
def test_of_many_connections_few_are_kept_and_nobody_is_shut_out(shown: Dashboard, session: tuple[str, str]) -> None:
    address, cookie = session
    before = len(os.listdir(f"/proc/{shown.process}/fd"))
    with ExitStack() as stack:
        at = ("127.0.0.1", shown.port)
        links = [stack.enter_context(socket.create_connection(at, PATIENCE_S)) for _ in range(CONNECTIONS)]
        for link in links[: CONNECTIONS - WAITING]:
            assert_dropped(link)
        assert asked(shown, address, cookie).status == 200
        assert len(os.listdir(f"/proc/{shown.process}/fd")) <= before + WAITING


def asked(shown: Dashboard, address: str, cookie: str = "") -> HTTPResponse:
    """The answer to somebody who is this user, read to its end."""
    link = HTTPConnection("127.0.0.1", shown.port, timeout=PATIENCE_S)
    link.request("GET", address.removeprefix(shown.base), headers={"Cookie": cookie})
    answer = link.getresponse()
    answer.read()
    link.close()
    return answer


def sent_until_dropped(link: socket.socket, piece: bytes, pause_s: float = 0.0) -> int:
    """How many bytes can be sent until the other end has had enough."""
    sent = 0
    while sent < 2 * SMALL:
        readable, writable, _ = select.select([link], [] if pause_s else [link], [], pause_s)
        try:
            if readable and not link.recv(1 << 16):
                break
            if writable or pause_s:
                sent += link.send(piece)
        except ConnectionError:
            break
    return sent


def assert_dropped(link: socket.socket) -> None:
    """The other end ends it, after an answer or without one, within the socket's patience."""
    try:
        while link.recv(1 << 16):
            pass
    except ConnectionError:
        pass


def peak(process: int) -> int:
    """The most memory that a process has had, in bytes."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{process}/status").read_text("utf-8"))
    assert found is not None
    return int(found[1]) << 10


def descendants(process: int) -> list[int]:
    """Of a process, itself left out."""
    own = [int(word) for path in Path(f"/proc/{process}/task").glob("*/children") for word in path.read_text().split()]
    return [*own, *(further for child in own for further in descendants(child))]


def link_in(page: Path) -> str:
    found = re.search(r"url=([^\"]+)\"", page.read_text("utf-8"))
    assert found is not None
    return found[1]
