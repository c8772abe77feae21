"""How a session is configured, and what a user reads of Zenoh's errors."""

import errno
import json
import logging
import os
import socket

import pytest
import zenoh

from deltaswarm_wire.logs import LogFormatter
from deltaswarm_wire.session import RouterLink, client_pairs, configured

SHARED_MEMORY = "transport/shared_memory/enabled"
LINK = RouterLink("tcp/127.0.0.1:7447")


def test_shared_memory_is_off_unless_the_user_asks_for_it() -> None:
    """Whatever else a session sets."""
    assert json.loads(configured(zenoh.Config, [], LINK).get_json(SHARED_MEMORY)) is False
    asked = RouterLink(LINK.endpoint, overrides=((SHARED_MEMORY, "true"),))
    assert json.loads(configured(zenoh.Config, client_pairs(asked), asked).get_json(SHARED_MEMORY)) is True


@pytest.mark.parametrize("setting", [("no/such", "1"), ("mode", "}")], ids=["unknown", "malformed"])
def test_a_refused_setting_shows_no_rust_source(setting: tuple[str, str]) -> None:
    """The setting and the reason are enough."""
    with pytest.raises(ValueError, match="Zenoh") as refusal:
        configured(zenoh.Config, [], RouterLink(LINK.endpoint, overrides=(setting,)))
    assert ".rs" not in str(refusal.value)
    assert setting[0] in str(refusal.value)


def test_a_log_shows_no_rust_source() -> None:
    """Neither in a message nor in the traceback below it; all else is kept, also where errors are nested."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        pairs = [("mode", "router"), ("listen/endpoints", [endpoint])]
        with pytest.raises(zenoh.ZError) as refusal:
            zenoh.open(configured(zenoh.Config, pairs, LINK))
    error = refusal.value
    assert ".rs:" in str(error), "Zenoh names no sources any more: `without_sources` is not needed"
    record = logging.LogRecord("n", logging.ERROR, "f", 1, "%s", (error,), (type(error), error, None))
    text = LogFormatter().format(record)
    assert ".rs" not in text
    assert text.count(os.strerror(errno.EADDRINUSE)) == 2
