"""The station's command line, and what its process loads."""

import http.client
import socket
import subprocess
import sys
from http import HTTPStatus
from urllib.parse import urlsplit

import pytest

from deltaswarm_operator.station.__main__ import main
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
