"""Who may begin and who waits, and how often from one address."""

from deltaswarm_serving.line import Limiter, Line


def test_as_many_begin_as_there_are_places_in_the_order_in_which_they_came() -> None:
    line = Line(2)
    for who in "cab":
        line.ask(who)
        line.ask(who)
    assert line.admit({"a", "b", "c"}) == ["c", "a"]
    assert line.admit({"a", "b", "c"}) == []
    assert (line.place("b", set()), line.place("c", set())) == (1, 0)
    line.leave("c")
    assert line.admit({"b"}) == ["b"]


def test_who_is_not_there_is_passed_over_and_keeps_the_place() -> None:
    line = Line(1)
    for who in "abc":
        line.ask(who)
    assert line.place("c", {"b", "c"}) == 2
    assert line.admit({"b", "c"}) == ["b"]
    line.leave("b")
    assert line.admit({"a", "c"}) == ["a"]


def test_only_who_has_begun_is_admitted_while_the_door_is_closed() -> None:
    line = Line(1, is_open=False)
    line.ask("a")
    assert line.admit({"a"}) == []
    line.ask("b")
    assert line.admit({"a", "b"}, begun={"b"}) == ["b"]
    line.leave("b")
    line.is_open = True
    assert line.admit({"a"}) == ["a"]


def test_who_leaves_the_line_is_not_admitted() -> None:
    line = Line(1)
    line.ask("a")
    line.leave("a")
    assert line.admit({"a"}) == []


def test_each_address_has_its_own_limit_in_a_span_of_time() -> None:
    limiter = Limiter(2, 10.0)
    assert [limiter.allows("a", now_s) for now_s in (0.0, 1.0, 2.0)] == [True, True, False]
    assert limiter.allows("b", 2.0)
    assert limiter.allows("a", 10.5)
    assert not limiter.allows("a", 10.6)


def test_quiet_addresses_are_forgotten() -> None:
    limiter = Limiter(1, 10.0)
    for number in range(1500):
        limiter.allows(str(number), float(number))
    assert len(limiter._seen) < 1100
