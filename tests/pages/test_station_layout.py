"""The places of everything on the participant's page: nothing covers anything, and the map stays as it is."""

from urllib.parse import urlsplit

import pytest

from tests.support.station_feed import ISA, TLX, Feed
from tests.support.station_page import NEEDS_BROWSER, Page
from tests.support.tiers import first_of

pytestmark = NEEDS_BROWSER

QUESTION = {"name": "open", "text": "How many events are open?", "kind": "number", "low": 0, "high": 99}
OVERLAPS = """
const seen = [...document.querySelectorAll("main > section, main > section > *, .asks > * button, #task button")]
    .filter((one) => one.checkVisibility({ visibilityProperty: true }) && one.id !== "judge");
const box = (one) => one.getBoundingClientRect();
return seen.flatMap((one, at) => seen.slice(at + 1).filter((other) => {
    const [a, b] = [box(one), box(other)];
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    return across > 1 && down > 1 && !one.contains(other) && !other.contains(one);
}).map((other) => `${one.id || one.className} ${other.id || other.className}`));
"""
SIZE = "const { width, height } = document.getElementById('map').getBoundingClientRect(); return `${width}x${height}`"


@pytest.mark.parametrize("size", first_of([(1366, 768), (1920, 1080), (1024, 768)]))
def test_nothing_lies_on_anything_and_the_map_keeps_its_scale(page: Page, size: tuple[int, int]) -> None:
    """While ISA, a question beside the map and a veto come and go, roles appear, and lines grow long."""
    screen = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    page.feed.send(page.player.swarm.hello(goal="Find the targets."))
    page.until(lambda: page.at("judge").is_displayed())
    sizes = set()
    form = {"name": "spam", "title": "A question", "text": "", "question": [QUESTION]}
    probes = (
        None,
        ISA,
        {"kind": "form", "number": 0, "hides": False, "left_s": 20.0, "form": form},
    )
    for at, probe in enumerate(probes):
        page.player.swarm.probe = probe
        long = [[n, 10 * n, 20, f"role number {n} with a long name", -1, -1, 100, 1, 0] for n in range(3 * at)]
        page.player.show(101.0 + at, proposal={"delta": 3, "left_s": 9.0} if at else None, agents=long)
        page.until(lambda at=at: page.text("time") == f"1:4{at + 1}" and len(page.texts("#agents-list > li")) == 3 * at)
        page.until(lambda probe=probe: page.at("form").is_displayed() == bool(probe and probe["kind"] == "form"))
        assert page.driver.execute_script(OVERLAPS) == []
        sizes.add(page.driver.execute_script(SIZE))
    assert len(sizes) == 1
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_between_the_runs_of_a_session_the_page_is_plain(page: Page) -> None:
    """Where the session stands, and at the end thanks: no map of the run before, and nothing that was not sent."""
    page.feed.send(page.player.swarm.hello(place=[2, 2], end_text="That was all."))
    page.player.swarm.over = True
    page.player.show(101.0)
    page.until(lambda: page.at("plain").is_displayed() and not page.at("map").is_displayed())
    assert page.text("plain-title") == "Run 2 of 2"
    page.ask(TLX, 102.0)
    page.player.swarm.probe = None
    page.player.show(103.0)
    page.feed.hang_up()
    page.until(lambda: page.text("plain-title") == "That was all.")
    page.press("p")
    assert not page.at("said").is_displayed()


def test_nobody_is_thanked_before_the_last_run(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    """The station of the next run says what run it is before it has a picture of it."""
    swarm, url = page.player.swarm, urlsplit(page.feed.url)
    page.feed.send(swarm.hello(run="first", place=[1, 2], end_text="Please wait."))
    page.player.show(101.0, over=True)
    page.feed.hang_up()
    page.until(lambda: page.text("plain-text") == "Please wait.")
    page.feed.close()
    monkeypatch.setenv("DELTASWARM_PASSWORD", url.path.strip("/"))
    with Feed("--listen", url.netloc) as second:
        second.send(swarm.hello(run="second", place=[2, 2], end_text="That was all."))
        page.until(lambda: page.text("plain-title") != "Run 1 of 2")
        assert page.text("plain-title") == "Run 2 of 2"
        assert page.text("plain-text") == "It begins soon."


def test_a_run_chooses_which_panels_the_participant_sees(page: Page) -> None:
    """What is left out is in no tab and at no place, and the map gets the room."""
    before = page.at("map").size["width"]
    page.feed.send(page.player.swarm.hello(panels=["events"]))
    page.until(lambda: page.at("panel-events").is_displayed())
    for name in ("workload", "inbox", "tab-commands", "tab-agents", "tab-notes"):
        assert not page.at(name).is_displayed(), name
    page.feed.send(page.player.swarm.hello(panels=[]))
    page.until(lambda: not page.at("side").is_displayed())
    assert page.at("map").size["width"] > before
