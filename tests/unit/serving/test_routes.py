"""Which page a request asks for, and whom the service listens to."""

import pytest

from deltaswarm_operator.station.rules import HEADERS
from deltaswarm_serving.routes import Route, Site, outside_id
from tests.support.tiers import in_one_test

PUBLIC = Site("127.0.0.1", "https://study.example.org/swarm")
LOCAL = Site("127.0.0.1")


@in_one_test(
    ("path", "route"),
    (
        ("/p/abc/", Route("p", "abc", ("",), "")),
        ("/p/abc", Route("p", "abc", (), "")),
        ("/p/abc/run/live", Route("p", "abc", ("run", "live"), "")),
        ("/j/abc/?PID=7", Route("j", "abc", ("",), "PID=7")),
        ("/o/abc/3/watch/", Route("o", "abc", ("3", "watch", ""), "")),
        ("/x/abc/", None),
        ("/p", None),
        ("/", None),
    ),
)
def test_a_path_has_a_kind_a_token_and_what_is_below(path: str, route: Route | None) -> None:
    """A proxy may have removed the public path, or not."""
    assert LOCAL.route(path) == route
    assert PUBLIC.route(path) == route
    assert PUBLIC.route(f"/swarm{path}") == route
    assert LOCAL.route(f"/swarm{path}") is None


def test_a_public_path_may_be_called_like_a_kind() -> None:
    """A proxy that removes it leaves addresses that begin in the same way."""
    site = Site("127.0.0.1", "https://study.example.org/p")
    for path in ("/p/abc/", "/p/p/abc/"):
        assert site.route(path) == Route("p", "abc", ("",), "")
    assert site.route("/p/j/abc/") == Route("j", "abc", ("",), "")


@in_one_test(
    "public", ["https://Study.Example.org", "https://study.example.org:443/swarm", "https://study.example.org"]
)
def test_browsers_write_the_public_address_in_their_own_way(public: str) -> None:
    site = Site("127.0.0.1", public)
    for host in ("study.example.org", "study.example.org:443"):
        assert site.is_ours(host)
        assert site.is_our_origin("https://study.example.org", host)
    for host in (
        "study.example.org:444",
        "me@study.example.org",
        "study.example.org/x",
        "study.example.org:x",
        "[",
        "",
    ):
        assert not site.is_ours(host)
    assert not site.is_our_origin("http://study.example.org", "study.example.org")


def test_a_path_that_only_begins_like_the_public_one_is_not_below_it() -> None:
    assert PUBLIC.route("/swarmp/abc/") is None


def test_only_our_own_names_are_ours() -> None:
    assert PUBLIC.is_ours("study.example.org")
    assert PUBLIC.is_ours("127.0.0.1:8420")
    assert not PUBLIC.is_ours("evil.example.org")
    assert not PUBLIC.is_ours("study.example.org.evil.org")
    assert not LOCAL.is_ours("study.example.org")


def test_only_our_own_pages_open_sockets() -> None:
    assert PUBLIC.is_our_origin("https://study.example.org", "study.example.org")
    assert not PUBLIC.is_our_origin("http://study.example.org", "study.example.org")
    assert not PUBLIC.is_our_origin("https://evil.example.org", "study.example.org")
    assert LOCAL.is_our_origin("http://127.0.0.1:8420", "127.0.0.1:8420")
    assert not LOCAL.is_our_origin("https://127.0.0.1:8420", "127.0.0.1:8420")
    assert Site("127.0.0.1", is_tls=True).is_our_origin("https://127.0.0.1:8420", "127.0.0.1:8420")


def test_nobody_may_embed_it_but_one_origin() -> None:
    name = "Content-Security-Policy"
    assert "frame-ancestors 'none'" in HEADERS[name]
    assert LOCAL.headers == {}
    told = Site("127.0.0.1", embed="https://survey.example.org").headers[name]
    assert told.endswith("frame-ancestors https://survey.example.org")
    assert told.startswith("default-src 'none'; script-src 'self'")


@pytest.mark.parametrize(("query", "found"), [("PID=a%20b", "a b"), ("PID=", ""), ("X=1", ""), ("PID=a&PID=b", "a")])
def test_an_id_from_elsewhere_is_taken_from_the_query(query: str, found: str) -> None:
    assert outside_id(query, "PID") == found
    assert outside_id(query, "") == ""


def test_an_id_from_elsewhere_has_a_bound() -> None:
    assert len(outside_id("PID=" + "x" * 10_000, "PID")) == 200
