"""A study by link: doors, lines, sessions of several people at once, kills, codes; all by the real service."""

import csv
import json
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from deltaswarm.testing import Recruiter
from tests.support import pages
from tests.support.by_link import (
    Participant,
    a_study,
    heard,
    kill,
    links_of,
    person,
    rows,
    serving,
    socket_at,
    states,
    together,
    tokens,
)
from tests.support.sessions import FORMS
from tests.support.swarms import told

pytestmark = pytest.mark.processes


def test_three_people_take_part_at_once_and_hand_in_codes(tmp_path: Path) -> None:
    file = a_study(tmp_path)
    frozen = told("session", str(file), "--freeze", "--out", str(tmp_path / "out"))
    links_of(file, 3)
    with serving(file) as service:
        people = [person(service.open_link, token) for token in tokens(file)]
        ends = together(people)
    assert [end and end["state"] for end in ends] == ["complete"] * 3
    for number, one in enumerate(people, 1):
        given = [rows(file, number, run, "actions") for run in ("0-training", "1-A")]
        assert [[row["input"] for row in acts if row["kind"] == "command"] for acts in given] == [
            [order] for order in one.orders
        ]
        assert any("consent_sha256=" in row["text"] for row in given[0])
    for number, end in enumerate(ends, 1):
        assert end is not None
        assert end["back"] == f"https://example.org/done?cc={end['code']}"
        proved = told("verify", str(tmp_path / "out"), "--code", end["code"])
        assert (proved.returncode, f"participant {number}: complete" in proved.stdout) == (0, True), proved.stdout
    verified = told("verify", str(tmp_path / "out"), "--against", frozen.stdout.split()[0])
    assert (verified.returncode, "6 of 6 planned runs are complete" in verified.stdout) == (0, True), verified.stdout


def test_a_code_tells_that_its_data_were_changed(tmp_path: Path) -> None:
    file = a_study(tmp_path, training_s=30, condition_s=30)
    links_of(file, 1)
    with serving(file) as service:
        [end] = together([person(service.open_link, tokens(file)[0])])
    assert end is not None
    table = tmp_path / "out" / "participant-001" / "1-A" / "actions.csv"
    table.write_text(table.read_text().replace("set delta", "set beta"))
    proved = told("verify", str(tmp_path / "out"), "--code", end["code"])
    assert (proved.returncode, "changed" in proved.stdout) == (1, True), proved.stdout
    assert told("verify", str(tmp_path / "out"), "--code", "AAAA-BBBB").returncode == 1


def test_a_person_waits_in_line_until_there_is_a_place(tmp_path: Path) -> None:
    file = a_study(tmp_path, training_s=30, condition_s=30, more="at_once = 1\n")
    with serving(file) as service:
        first = joined(f"{service.open_link}?PID=ann")
        first.at_door("running")
        second = joined(f"{service.open_link}?PID=bob")
        with socket_at(second.link, "door") as door:
            assert heard(door, lambda message: message["type"] == "door")["place"] == 1
            ends = together([first])
            assert ends[0] is not None
            heard(door, lambda message: message.get("state") == "running")
        [end] = together([second])
        assert end is not None
        assert joined(f"{service.open_link}?PID=ann").link == first.link
    assert states(file) == ["complete", "complete"]
    links = json.loads((tmp_path / "out" / "links.json").read_text())["links"]
    assert [(link["number"], link["outside"]) for link in links] == [(1, "ann"), (2, "bob")]
    told("session", str(file), "--out", str(tmp_path / "out"), "--table", str(tmp_path / "tables"))
    assert not [path for path in (tmp_path / "tables").rglob("*") if path.is_file() and b"bob" in path.read_bytes()]


def test_a_recruiting_service_sends_people_and_gets_them_back_with_their_codes(tmp_path: Path) -> None:
    """Two complete, one gives the place back and is not taken again; each code is of its own person's data."""
    file = a_study(tmp_path, training_s=30, condition_s=30)
    with Recruiter("PID") as recruiter:
        file.write_text(file.read_text().replace("https://example.org/done?cc={code}", recruiter.return_url))
        with serving(file) as service:
            recruiter.publish(service.open_link)
            people = []
            for _ in range(3):
                browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
                with browser.open(recruiter.invite()) as page:
                    people.append((browser, joined(page.url)))
            gone = list(recruiter.submissions)[2]
            recruiter.give_back(gone)
            ends = together([one for _, one in people])
            for (browser, _), end in zip(people, ends, strict=True):
                browser.open((end or {})["back"]).close()
        submissions = list(recruiter.submissions.values())
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(recruiter.return_url)  # a stranger
    assert [one.state for one in submissions] == ["awaiting review", "awaiting review", "returned"]
    assert submissions[2].code == ""
    links = json.loads((tmp_path / "out" / "links.json").read_text())["links"]
    assert [link["outside"] for link in links] == [one.person for one in submissions]
    for number, one in enumerate(submissions[:2], 1):
        proved = told("verify", str(tmp_path / "out"), "--code", one.code)
        assert (proved.returncode, f"participant {number}: complete" in proved.stdout) == (0, True), proved.stdout


def test_agents_may_be_processes(tmp_path: Path) -> None:
    """The same session, the same answers, and no process is left."""
    file = a_study(tmp_path, training_s=30, condition_s=30)
    plan = told("session", str(file), "--freeze", "--out", str(tmp_path / "out")).stdout.split()[0]
    links_of(file, 1)
    with serving(file, "--agents", "processes") as service:
        one = person(service.open_link, tokens(file)[0])
        assert (one.go_through() or {})["state"] == "complete"
    acts = [row for run in ("0-training", "1-A") for row in rows(file, 1, run, "actions")]
    assert [row["input"] for row in acts if row["kind"] == "command"] == one.orders
    assert any("consent_sha256=" in row["text"] for row in acts)
    pids = json.loads((tmp_path / "out" / "participant-001" / "1-A" / "logs" / "pids.json").read_text())
    assert len([role for role in pids if role.startswith("agent")]) == 6
    verified = told("verify", str(tmp_path / "out"), "--against", plan)
    assert (verified.returncode, "2 of 2 planned runs are complete" in verified.stdout) == (0, True), verified.stdout


def joined(open_link: str) -> Participant:
    """Come by the open link."""
    with socket_at(open_link, "door") as door:
        if (message := heard(door, lambda message: message["type"] in ("door", "go")))["type"] == "door":
            door.send('{"type":"agree"}')
            message = heard(door, lambda message: message["type"] == "go")
    return Participant(f"{open_link.partition('/j/')[0]}{message['address'].removeprefix('../..')}")


def test_robots_rehearse_a_whole_session_and_answer_everything(tmp_path: Path) -> None:
    """A task, forms before and after, ISA and NASA-TLX with weights; nothing is missing, and the study has no data."""
    file = a_study(tmp_path, training_s=30, condition_s=60, more=FORMS)
    keys = ("operator.probes.isa_every_s=20", "operator.probes.tlx_weights=true", "operator.task.target_share=0.5")
    file.write_text(file.read_text().replace('"operator.probes.isa_every_s=0"', ", ".join(map(repr, keys))))
    out = tmp_path / "out"
    refused = told("serve", str(file), "--out", str(out), "--robots", "2")
    assert (refused.returncode, "--pilot" in refused.stderr) == (2, True)
    done = told("serve", str(file), "--out", str(out), "--pilot", "--robots", "2", "--listen", "127.0.0.1:0")
    assert (done.returncode, "robots complete: 2" in done.stderr) == (0, True), done.stderr
    tables = told("session", str(file), "--out", str(out), "--pilot", "--table", str(tmp_path / "tables"))
    assert tables.returncode == 0, tables.stderr
    with (tmp_path / "tables" / "runs.tsv").open(newline="") as stream:
        runs = list(csv.DictReader(stream, delimiter="\t"))
    assert [(run["complete"], run["answered_share"]) for run in runs] == [("1", "1.0")] * 4
    assert not list(out.glob("participant-*"))


def test_looking_at_a_link_changes_nothing(tmp_path: Path) -> None:
    file = a_study(tmp_path)
    links_of(file, 1)
    before = (tmp_path / "out" / "links.json").read_bytes()
    with serving(file) as service:
        one = person(service.open_link, tokens(file)[0])
        for address in (one.link, service.open_link, f"{service.open_link}?PID=ann"):
            for _ in range(2):
                with urllib.request.urlopen(address) as page:
                    assert page.status == 200
        with socket_at(one.link, "door") as door:
            assert heard(door, lambda message: message["type"] == "door")["state"] == "new"
    after = json.loads((tmp_path / "out" / "links.json").read_bytes())
    assert after == json.loads(before)
    assert not list((tmp_path / "out").glob("participant-*"))


def test_one_persons_link_opens_nothing_of_anothers(tmp_path: Path) -> None:
    file = a_study(tmp_path)
    links_of(file, 1)
    with serving(file) as service:
        base = service.open_link.partition("/j/")[0]
        own = tokens(file)[0]
        for path in (
            f"/o/{own}/",
            f"/j/{own}/",
            "/p/wrong/",
            "/p//",
            "/",
            "/p/../links.json",
            f"/p/{own}/run/../../links.json",
        ):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(base + path)
            assert refused.value.code == 404
        strange = urllib.request.Request(base + f"/p/{own}/", headers={"Host": "evil.example"})
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(strange)
        assert refused.value.code == 421


def test_the_experimenter_sees_ends_and_stops_admissions(tmp_path: Path) -> None:
    file = a_study(tmp_path, speed=5.0)
    links_of(file, 2)
    with serving(file) as service, socket_at(service.overview, "live") as overview:
        one, other = (person(service.open_link, token) for token in tokens(file))
        assert one.go_through(lambda hello, picture: picture["step"] > 5) is None
        seen = heard(overview, lambda message: message["rows"][0]["state"] == "running")
        assert (seen["rows"][0]["number"], seen["inside"]) == (1, 1)
        overview.send('{"type":"admissions","open":false}')
        overview.send('{"type":"note","number":1,"text":"late"}')
        heard(overview, lambda message: message["closed"] == "paused")
        assert other.at_door("waiting")["closed"] == "paused"
        kill(tmp_path)  # who has begun goes on
        assert one.go_through(lambda hello, picture: picture["step"] > 15) is None
        overview.send('{"type":"end","number":1}')
        assert one.at_door("ended")["code"]
        last = heard(overview, lambda message: message["rows"][0]["state"] == "ended")
    assert last["rows"][0]["note"] == "late"


def test_who_stays_away_gives_up_the_place_and_may_come_back(tmp_path: Path) -> None:
    file = a_study(tmp_path, training_s=60, condition_s=30, more="absent_after_s = 5\nat_once = 1\n")
    links_of(file, 2)
    with serving(file) as service:
        one, other = (person(service.open_link, token) for token in tokens(file))
        assert one.go_through(lambda hello, picture: picture["step"] > 20) is None
        left = time.monotonic()
        [end] = together([other])
        assert end is not None
        assert time.monotonic() - left > 5.0
        assert states(file) == ["away", "complete"]
        assert (one.go_through() or {})["state"] == "complete"


def test_the_commands_of_the_page_serve_the_file_of_the_page_about_sessions(tmp_path: Path) -> None:
    [command] = pages.commands((pages.ROOT / "docs" / "BY_LINK.md").read_text())
    for name, text in pages.files((pages.ROOT / "docs" / "SESSION.md").read_text()).items():
        (tmp_path / name).write_text(text)
    (tmp_path / "consent.txt").write_text("Yes\n")
    pages.serve(f"{command} --listen 127.0.0.1:0", tmp_path)
