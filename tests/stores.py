"""Stores on this machine's loopback, each by a server nobody here wrote: S3, a web server with ranges, SSH."""

import os
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import flask
import fsspec
import paramiko
import pytest
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

USER, PASSWORD = "ada", "engine"


@dataclass
class Traffic:
    """What a server was asked and how many bytes it gave; with `cut` it breaks off in the middle of files called so.

    What is `refused` is answered by 403, or another `refusal`.
    """

    requests: list[str] = field(default_factory=list)
    bytes: int = 0
    cut: str = ""
    refused: Callable[[str], bool] = lambda _request: False
    refusal: str = "403 Forbidden"

    def forget(self) -> None:
        """Count anew."""
        self.requests.clear()
        self.bytes = 0

    @property
    def writing(self) -> list[str]:
        """The requests that do not only read."""
        return [one for one in self.requests if not one.startswith(("GET", "HEAD"))]


@contextmanager
def served(application: Any) -> Iterator[tuple[str, Traffic]]:
    """A WSGI application on a free port, counted: its address, and what it is asked."""
    traffic = Traffic()

    def counted(environ: Any, start_response: Any) -> Iterable[bytes]:
        request = f"{environ['REQUEST_METHOD']} {environ['PATH_INFO']}?{environ['QUERY_STRING']}"
        traffic.requests.append(request)
        if traffic.refused(request):
            start_response(traffic.refusal, [])
            return []
        answer = application(environ, start_response)
        try:
            body = b"".join(answer)
        finally:
            getattr(answer, "close", lambda: None)()
        traffic.bytes += len(body)
        return [body[: len(body) // 2] if traffic.cut and traffic.cut in environ["PATH_INFO"] else body]

    server = make_server("127.0.0.1", 0, counted, threaded=True)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", traffic
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextmanager
def s3() -> Iterator[tuple[str, Traffic]]:
    """An S3 of one's own, with nothing of what another one in this process has held."""
    with served(DomainDispatcherApplication(create_backend_app)) as (address, traffic):
        urlopen(Request(f"{address}/moto-api/reset", method="POST")).close()  # noqa: S310
        traffic.forget()
        fsspec.get_filesystem_class("s3").clear_instance_cache()  # of one at another address
        yield address, traffic


def account(address: str) -> dict[str, str]:
    """The variables by which programs find that S3, and nobody else's."""
    return {
        "AWS_ACCESS_KEY_ID": "one",
        "AWS_SECRET_ACCESS_KEY": "two",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": address,
        "AWS_MAX_ATTEMPTS": "1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }


@contextmanager
def bucket_of(folder: Path, url: str) -> Iterator[Traffic]:
    """The files of a folder on an S3 of one's own, at `url`; this process and those it starts have its credentials."""
    with pytest.MonkeyPatch.context() as patch, s3() as (address, traffic):
        for name, value in account(address).items():
            patch.setenv(name, value)
        system = fsspec.filesystem("s3")
        system.mkdir(url.removeprefix("s3://").partition("/")[0])
        for path in folder.rglob("*"):
            if path.is_file():
                system.put(str(path), f"{url}/{path.relative_to(folder)}")
        traffic.forget()
        yield traffic


@contextmanager
def web(folder: Path) -> Iterator[tuple[str, Traffic]]:
    """The files of a folder by HTTP, with ranges and an index page for each folder, as any web server has it."""
    application = flask.Flask(__name__)

    @application.route("/", defaults={"inner": ""})
    @application.route("/<path:inner>")
    def answer(inner: str) -> Any:
        there = folder / inner
        if not there.is_dir():
            return flask.send_from_directory(folder, inner, conditional=True)
        if inner and not inner.endswith("/"):
            return flask.redirect(f"/{inner}/")
        names = (f"{one.name}/" if one.is_dir() else one.name for one in there.iterdir())
        return "".join(f'<a href="{name}">{name}</a>' for name in names)

    with served(application) as found:
        yield found


class _Doorkeeper(paramiko.ServerInterface):  # type: ignore[misc]
    def __init__(self, key: paramiko.PKey) -> None:
        self._key = key

    def get_allowed_auths(self, username: str) -> str:
        return "password,publickey"

    def check_auth_publickey(self, username: str, key: paramiko.PKey) -> int:
        known = (username, key) == (USER, self._key)
        return int(paramiko.AUTH_SUCCESSFUL if known else paramiko.AUTH_FAILED)

    def check_auth_password(self, username: str, password: str) -> int:
        known = (username, password) == (USER, PASSWORD)
        return int(paramiko.AUTH_SUCCESSFUL if known else paramiko.AUTH_FAILED)

    def check_channel_request(self, kind: str, chanid: int) -> int:
        return int(paramiko.OPEN_SUCCEEDED)


class _Files(paramiko.SFTPServerInterface):  # type: ignore[misc]
    """This machine's files to read, and those in one folder to write.

    Somebody else makes folders called `busy` there just before they are asked for. Those called `closed` are listed to
    nobody, and of those called `asleep` nothing is heard as long as the server is there.
    """

    ended = threading.Event()

    def __init__(self, server: paramiko.ServerInterface, home: Path) -> None:
        super().__init__(server)
        self._home = home

    def _may_write(self, path: str) -> bool:
        return f"/{path.lstrip('/')}".startswith(f"{self._home}/")

    def list_folder(self, path: str) -> Any:
        if path.endswith("/closed"):
            return paramiko.SFTP_PERMISSION_DENIED
        if path.endswith("/asleep"):
            self.ended.wait()
        found = []
        for name in os.listdir(path):
            about = paramiko.SFTPAttributes.from_stat(os.lstat(os.path.join(path, name)))
            about.filename = name
            found.append(about)
        return found

    def stat(self, path: str) -> Any:
        try:
            return paramiko.SFTPAttributes.from_stat(os.stat(path))
        except OSError as error:
            return paramiko.SFTPServer.convert_errno(error.errno or 0)

    def lstat(self, path: str) -> Any:
        return self.stat(path)

    def open(self, path: str, flags: int, attr: Any) -> Any:
        handle = paramiko.SFTPHandle(flags)
        if not flags & (os.O_WRONLY | os.O_RDWR):
            handle.readfile = open(path, "rb")  # noqa: SIM115 -- closed with its handle
        elif self._may_write(path):
            handle.writefile = open(path, "wb")  # noqa: SIM115
        else:
            return paramiko.SFTP_PERMISSION_DENIED
        return handle

    def mkdir(self, path: str, attr: Any) -> int:
        if not self._may_write(path):
            return int(paramiko.SFTP_PERMISSION_DENIED)
        os.mkdir(path)
        return int(paramiko.SFTP_FAILURE if path.endswith("/busy") else paramiko.SFTP_OK)


@contextmanager
def ssh(home: Path) -> Iterator[str]:
    """An SFTP server: the address that has all files of this machine, user and password in it.

    What is in `home` may be written; the user's key is put there, where programs whose HOME it is find it.
    """
    with socket.create_server(("127.0.0.1", 0)) as listening:
        key = paramiko.RSAKey.generate(2048)
        (home / ".ssh").mkdir()
        key.write_private_key_file(home / ".ssh" / "id_rsa")
        sessions: list[paramiko.Transport] = []
        _Files.ended.clear()

        def accept() -> None:
            while True:
                try:
                    connection, _ = listening.accept()
                except OSError:
                    return
                session = paramiko.Transport(connection)
                session.add_server_key(key)
                session.set_subsystem_handler("sftp", paramiko.SFTPServer, _Files, home)
                session.start_server(server=_Doorkeeper(key))
                sessions.append(session)

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        try:
            yield f"sftp://{USER}:{PASSWORD}@127.0.0.1:{listening.getsockname()[1]}"
        finally:
            _Files.ended.set()
            for session in sessions:
                session.close()
            listening.shutdown(socket.SHUT_RDWR)
            thread.join()
