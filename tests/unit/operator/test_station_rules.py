"""Whom the station lets in: names and addresses of hosts."""

from deltaswarm_operator.station import rules


def test_hosts_that_are_ours() -> None:
    """Names only if they were asked for; addresses where others may come."""
    assert rules.is_our_host("127.0.0.1:8000", "127.0.0.1")
    assert rules.is_our_host("[::1]:8000", "::1")
    assert not rules.is_our_host("192.168.1.2:8000", "127.0.0.1")
    assert rules.is_our_host("192.168.1.2:8000", "0.0.0.0")
    assert rules.is_our_host("station.lab:8000", "station.lab")
    assert not rules.is_our_host("evil.example", "0.0.0.0")
    for strange in (None, "", "[", "[::1", "@", "a@127.0.0.1.evil.example"):
        assert not rules.is_our_host(strange, "127.0.0.1")


def test_each_role_has_its_own_address() -> None:
    """A watcher's follows from the participant's, and not the other way round; nothing else is let in."""
    watch = rules.watch_token("secret")
    tokens = {rules.OPERATE: "secret", rules.WATCH: watch}
    assert rules.watch_token("secret") == watch != rules.watch_token("other")
    assert "secret" not in watch
    assert rules.role_and_path(tokens, "/secret/live?x") == (rules.OPERATE, "live")
    assert rules.role_and_path(tokens, f"/{watch}/map.js") == (rules.WATCH, "map.js")
    for path in (f"/{rules.watch_token(watch)}/live", "/", "", "/secret", f"//{watch}/", f"/{watch[:-1]}/"):
        assert rules.role_and_path(tokens, path) is None
    assert rules.role_and_path({rules.OPERATE: "secret"}, f"/{watch}/live") is None
