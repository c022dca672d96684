"""Pages from elsewhere in the operator's own browser: of another port of this machine, of another name for it.

The browser has a session all the while. What such a page can at worst know, the path of the session, it is given.
"""

import http.server
import json
import os
import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from playwright.sync_api import Browser, Page, expect

from tests.dashboard.browser import FLAGS, Dashboard, chromium, connected, dashboard, enter, needs_chromium, opened
from tests.system.waiting import until

pytestmark = needs_chromium

PAGE = b'<!doctype html><link rel="icon" href="data:,"><title>elsewhere</title><body>'
WORKER = """
self.addEventListener("message", async event => {
    const answer = await fetch(event.data, {credentials: "include", mode: "no-cors"}).catch(String);
    event.source.postMessage(String(answer));
});
"""
SOCKET_IO = "_nicegui_ws/socket.io/?EIO=4&transport="
FRAME = """const frame = document.createElement("iframe"); frame.name = "frame"; document.body.append(frame);"""
ATTACKS = {
    "fetch": "await fetch(path, {credentials: 'include'}).catch(String)",
    "fetch without an answer": "await fetch(path, {credentials: 'include', mode: 'no-cors'}).catch(String)",
    "fetch that acts": "await fetch(path, {credentials: 'include', mode: 'no-cors', method: 'POST'}).catch(String)",
    "polling": f"await fetch(path + '{SOCKET_IO}polling', {{credentials: 'include', mode: 'no-cors'}}).catch(String)",
    "frame": FRAME + "frame.src = path; await new Promise(done => frame.onload = done)",
    "form": FRAME
    + """const form = document.createElement("form"); form.method = "POST"; form.action = path; form.target = "frame";
        document.body.append(form); form.submit(); await new Promise(done => frame.onload = done)""",
    "picture": "const it = new Image(); it.src = path; await new Promise(done => it.onload = it.onerror = done)",
    "script": """const it = document.createElement("script"); it.src = path; document.body.append(it);
        await new Promise(done => it.onload = it.onerror = done)""",
    "events": """const it = new EventSource(path, {withCredentials: true});
        await new Promise(done => it.onopen = it.onerror = done); it.close()""",
}


@dataclass
class Elsewhere:
    """A server at another port of this machine; `heard` is the headers of every request to it."""

    port: int = 0
    heard: list[dict[str, str]] = field(default_factory=list)

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.port}"


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dashboard]:
    with dashboard(tmp_path_factory.mktemp("runs")) as found:
        yield found


@pytest.fixture
def page(window: Browser, shown: Dashboard) -> Iterator[Page]:
    """The list of runs, of somebody who was let in."""
    page = opened(window)
    enter(page, shown)
    expect(page.locator(".all-region")).to_be_visible()
    connected(page)
    yield page
    page.context.close()


@pytest.fixture
def elsewhere() -> Iterator[Elsewhere]:
    found = Elsewhere()

    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found.heard.append(dict(self.headers))
            script = self.path == "/worker.js"
            self.send_response(200)
            self.send_header("Content-Type", "text/javascript" if script else "text/html")
            self.end_headers()
            self.wfile.write(WORKER.encode() if script else PAGE)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        found.port = server.server_port
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield found
        server.shutdown()
        thread.join()


def test_the_cookie_is_sent_to_no_other_port(page: Page, elsewhere: Elsewhere) -> None:
    secret = page.url.split("/")[3]
    (cookie,) = page.context.cookies(page.url)
    other = page.context.new_page()
    for path in ("/", "/run/a", "/_nicegui/x", "/labctl/"):
        other.goto(f"{elsewhere.base}{path}")
    page.evaluate("address => { location.href = address }", elsewhere.base)
    page.wait_for_url(f"{elsewhere.base}/")
    assert len(elsewhere.heard) >= 5
    heard = json.dumps(elsewhere.heard)
    assert cookie["value"] not in heard
    assert secret not in heard, "no Referer either"
    assert other.evaluate("document.cookie") == ""


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_page_at_another_port_reaches_nothing(page: Page, elsewhere: Elsewhere, attack: str) -> None:
    """The answers are those of the server, before the browser keeps them from the page that asked."""
    other = page.context.new_page()
    other.goto(elsewhere.base)
    answers: list[int] = []
    network = page.context.new_cdp_session(other)
    network.send("Network.enable")
    network.on("Network.responseReceivedExtraInfo", lambda answer: answers.append(answer["statusCode"]))
    other.evaluate(f"async path => {{ {ATTACKS[attack]} }}", page.url)
    other.wait_for_function("document.readyState === 'complete'")  # so that all events are here
    assert set(answers) == {403}


def test_a_service_worker_of_another_port_reaches_nothing(page: Page, elsewhere: Elsewhere) -> None:
    asks = """async path => {
        await navigator.serviceWorker.register("/worker.js");
        const ready = await navigator.serviceWorker.ready;
        const told = new Promise(done => navigator.serviceWorker.onmessage = event => done(event.data));
        ready.active.postMessage(path);
        return await told;
    }"""
    other = page.context.new_page()
    other.goto(elsewhere.base)
    assert "TypeError" in other.evaluate(asks, page.url)


def test_a_page_at_another_port_opens_no_websocket(page: Page, elsewhere: Elsewhere) -> None:
    opens = """address => new Promise(done => {
        const socket = new WebSocket(address);
        socket.onopen = () => done("opened");
        socket.onerror = () => done("refused");
    })"""
    address = f"{page.url.replace('http', 'ws', 1)}{SOCKET_IO}websocket"
    other = page.context.new_page()
    other.goto(elsewhere.base)
    assert other.evaluate(opens, address) == "refused"
    assert page.evaluate(opens, address) == "opened"


def test_a_window_that_another_page_opened_shows_nothing(page: Page, elsewhere: Elsewhere) -> None:
    other = page.context.new_page()
    other.goto(elsewhere.base)
    with other.expect_popup() as opening:
        other.evaluate("path => { window.open(path) }", page.url)
    expect(opening.value.locator("body")).to_contain_text("Nobody is let in")
    other.evaluate("path => { location.href = path }", page.url)
    expect(other.locator("body")).to_contain_text("Nobody is let in")


def test_cookies_of_another_port_shut_nobody_out(page: Page, elsewhere: Elsewhere) -> None:
    other = page.context.new_page()
    other.goto(elsewhere.base)
    other.evaluate("document.cookie = 'labctl=mine; path=/'")
    page.reload()
    expect(page.locator(".all-region")).to_be_visible()
    connected(page)


def test_another_name_for_this_machine_is_refused_and_uses_no_link_up(window: Browser, shown: Dashboard) -> None:
    """As after DNS rebinding: the browser believes that it talks to the other page's own server."""
    link, page = next(shown.links), opened(window)
    answer = page.goto(link.replace("127.0.0.1", "evil.localhost"))
    assert answer is not None
    assert answer.status == 403
    page.goto(link)
    expect(page.locator(".all-region")).to_be_visible()
    page.context.close()


def test_a_second_browser_needs_a_link_of_its_own(window: Browser, shown: Dashboard) -> None:
    used, first, second = next(shown.links), opened(window), opened(window)
    first.goto(used)
    expect(first.locator(".all-region")).to_be_visible()
    for address in (used, first.url, shown.base):
        answer = second.goto(address)
        assert answer is not None
        assert answer.status == 403
    assert enter(second, shown) != first.url
    expect(second.locator(".all-region")).to_be_visible()
    for page in (first, second):
        page.reload()
        expect(page.locator(".all-region")).to_be_visible()
        page.context.close()


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks into /proc")
def test_the_browser_that_is_opened_gets_in_and_nobody_is_shown_how(window: Browser, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    program, profile = tmp_path / "browser", tmp_path / "profile"
    flags = " ".join(FLAGS)
    program.write_text(
        f'#!/bin/sh\nexec {chromium()} --headless --remote-debugging-port=0 --user-data-dir={profile} {flags} "$@"\n',
        encoding="utf-8",
    )
    program.chmod(0o700)
    with dashboard(runs, {"HOME": str(tmp_path), "BROWSER": f"{program} %s"}) as served, ended(profile):
        port = awaited(profile / "DevToolsActivePort", r"^(\d+)\n")
        (context,) = window.browser_type.connect_over_cdp(f"http://127.0.0.1:{port}").contexts
        (page,) = context.pages
        expect(page.locator(".all-region")).to_be_visible()
        assert re.fullmatch(f"{re.escape(served.base)}/[^/?]+/", page.url)
        secret = page.url.split("/")[3].encode()
        lines = command_lines()
        assert any(b"/open.html" in line and b"file://" in line for line in lines)
        assert not [line for line in lines if b"token=" in line or secret in line]
        assert not list(tmp_path.glob("labctl-*")), "what was used is removed"


@contextmanager
def ended(profile: Path) -> Iterator[None]:
    """The browser with this profile ends with the block."""
    try:
        yield
    finally:
        for process in Path("/proc").glob("[0-9]*"):
            if f"--user-data-dir={profile}".encode() in _words(process) and b"--type" not in b"".join(_words(process)):
                os.kill(int(process.name), signal.SIGKILL)


def awaited(file: Path, pattern: str) -> str:
    """What another process comes to write into a file."""
    return until(lambda: re.match(pattern, file.read_text("utf-8")) if file.exists() else None)[1]


def command_lines() -> list[bytes]:
    """Those that every user can read."""
    return [b" ".join(_words(process)) for process in Path("/proc").glob("[0-9]*")]


def _words(process: Path) -> list[bytes]:
    try:
        return (process / "cmdline").read_bytes().split(b"\0")
    except OSError:
        return []
