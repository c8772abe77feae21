"""The places of everything on the participant's page: nothing covers anything, and the map stays as it is."""

from random import Random
from urllib.parse import urlsplit

import pytest

from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.task import GOAL
from tests.support.station_feed import ISA, TLX, Feed
from tests.support.station_page import NEEDS_BROWSER, Page
from tests.support.tiers import first_of

pytestmark = NEEDS_BROWSER

QUESTION = {"name": "open", "text": "How many events are open?", "kind": "number", "low": 0, "high": 99}
OVERLAPS = """
const parts = "main > section, .beside section, main section > *, .asks > * button, #task button";
const seen = [...document.querySelectorAll(parts)]
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


PLACES = """
const moving = ["judge-target", "judge-decoy", "veto"];
const parts = "header button, main section:not(#isa), main button, main select, main label";
const seen = [...document.querySelectorAll(parts)];
const kept = seen.filter((one) => !one.closest("#isa, li, dialog, #panel-commands") && !moving.includes(one.id));
return Object.fromEntries(kept.map((one, at) => {
    const { x, y, width, height } = one.getBoundingClientRect();
    return [`${at} ${one.id || one.className}`, [x, y, width, height].map(Math.round).join(" ")];
}));
"""
CUT = """
const text = (one) => [...one.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim());
const isSeen = (one) => one.checkVisibility({ visibilityProperty: true });
return [...document.querySelectorAll("header *, main *")]
    .filter((one) => text(one) && isSeen(one) && !one.closest(".unseen, canvas, select, ul, ol"))
    .filter((one) => {
        const isBox = getComputedStyle(one).display !== "inline";
        const around = one.closest("main section, header").getBoundingClientRect();
        const isBeyond = one.getBoundingClientRect().right > around.right + 1;
        return isBox && one.scrollWidth > one.clientWidth + 1 || isBeyond;
    })
    .map((one) => `${one.id || one.className || one.tagName}: ${one.textContent.trim()}`);
"""


def test_nothing_moves_over_a_run(page: Page) -> None:
    """Events come, are judged and go, questions open and close, rates grow, orders are proposed: all stays in place."""
    page.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 1366, "height": 768, "deviceScaleFactor": 1, "mobile": False}
    )
    page.feed.send(page.player.swarm.hello(goal="Find the targets.", sets_delta="system"))
    page.until(lambda: page.at("judge").is_displayed())
    chance = Random(60)
    swarm = page.player.swarm
    places = []
    for at in range(25):
        swarm.events = chance.randint(0, 9)
        swarm.probe = chance.choice([None, ISA, {**ISA, "number": at}])
        swarm.judged = dict.fromkeys(range(chance.randint(0, swarm.events)), "target")
        proposal = {"delta": 3, "left_s": 9.0} if chance.random() < 0.3 else None
        page.player.show(60.0 + 40.0 * at, proposal=proposal, unread=chance.choice([0, 7, 1234]))
        minutes, seconds = divmod(60 + 40 * at, 60)
        page.until(lambda minutes=minutes, seconds=seconds: page.text("time") == f"{minutes}:{seconds:02}")
        page.drawn()
        places.append(page.driver.execute_script(PLACES))
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    moved = {name for one in places for name, place in one.items() if places[0].get(name) != place}
    assert moved == set()


@pytest.mark.parametrize("language", ["", "de"])
def test_no_text_is_cut(page: Page, language: str) -> None:
    """From a phone to a large screen, in both languages."""
    told = load_scenario("smoke", [f"operator.page.language={language}"]).operator.page.language.told
    page.feed.send(page.player.swarm.hello(goal=GOAL, language=told))
    page.until(lambda: page.at("judge-next").is_displayed())
    found = {}
    for width, height in ((390, 844), (768, 1024), (1024, 768), (1366, 768), (1920, 1080)):
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 700}
        page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        for probe in (None, ISA):
            page.player.swarm.probe = probe
            page.player.show(102.0 + width)
            page.until(lambda probe=probe: page.at("isa").is_displayed() == bool(probe))
            page.drawn()
            found[width, bool(probe)] = page.driver.execute_script(CUT)
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert {at: cut for at, cut in found.items() if cut} == {}


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
