"""The station's command line, and what its process loads."""

import asyncio
import http.client
import socket
import ssl
import subprocess
import sys
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from deltaswarm_operator.station.__main__ import main
from deltaswarm_operator.station.visitors import listening, response
from deltaswarm_orchestrator.processes import certificates
from tests.support.station_feed import PATIENCE_S, Feed


def test_the_channel_must_be_a_socket_of_the_right_kind(capsys: pytest.CaptureFixture[str]) -> None:
    one, other = socket.socketpair()
    with other:
        assert main(["--channel-fd", str(one.detach())]) == 2
    assert "SOCK_SEQPACKET" in capsys.readouterr().err
    assert main(["--channel-fd", "987"]) == 2
    for wrong in ("8000", "h:99999", ":1", "h:x"):
        with pytest.raises(SystemExit):
            main(["--channel-fd", "987", "--listen", wrong])


def test_the_station_knows_no_fabric() -> None:
    """Its process never loads Zenoh, so it cannot know more than its feed."""
    code = "import deltaswarm_operator.station.__main__, sys; print('zenoh' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_other_methods_than_get_are_not_allowed() -> None:
    with Feed() as feed:
        link = urlsplit(feed.url)
        for method, body in (("POST", "x" * 100_000), ("PUT", None), ("DELETE", None), ("HEAD", None), ("GET", None)):
            asking = http.client.HTTPConnection(link.netloc, timeout=PATIENCE_S)
            asking.request(method, link.path, body=body)
            answer = asking.getresponse()
            if method == "GET":
                assert answer.status == HTTPStatus.OK
            else:
                assert (answer.status, answer.headers["Allow"]) == (HTTPStatus.METHOD_NOT_ALLOWED, "GET"), method
            asking.close()


async def asked_by_tls(folder: Path, method: str) -> bytes:
    """What a server that speaks TLS itself answers; an error of its own fails the test."""
    certificates.make(folder, [], [], 1)
    ours, theirs = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.create_default_context(cafile=folder / "ca.pem")
    ours.load_cert_chain(folder / "operator.pem", folder / "operator.key")
    errors: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, told: errors.append(told))

    async def converse(_: object) -> None:
        return None

    async with listening(converse, "127.0.0.1", 0, lambda *_: response(HTTPStatus.OK), ssl=ours) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=theirs)
        writer.write(f"{method} / HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
        writer.close()
    assert errors == []
    return answer


def test_other_methods_are_refused_by_tls_too(tmp_path: Path) -> None:
    """A connection by TLS cannot be closed in one direction alone."""
    assert asyncio.run(asked_by_tls(tmp_path, "HEAD")).startswith(b"HTTP/1.1 405 ")
