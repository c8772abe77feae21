"""The page about ROS 2 robots: its files, keys and bytes are those of the code."""

import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_board.bodies import find_body, options_of
from deltaswarm_board.settings import read_settings
from deltaswarm_field.ros2_publisher import TOPICS as LIVE
from deltaswarm_ros2.cdr import encode
from deltaswarm_ros2.definitions import (
    CLOCK,
    HASHES,
    ODOMETRY,
    POSE_ARRAY,
    POSE_STAMPED,
    TWIST,
    TWIST_STAMPED,
)
from deltaswarm_ros2.keys import (
    PUBLISHER,
    RMW_ZENOH,
    ROS2DDS,
    SUBSCRIPTION,
    Node,
    endpoint_token,
    full_name,
    node_token,
    topic_key,
)
from deltaswarm_ros2.settings import Ros2Settings
from tests.support.fields import endpoint, free_port
from tests.support.pages import ROOT, commands
from tests.support.ros2_robots import fleet
from tests.support.swarms import PATIENCE_S, wait_until
from tests.support.tiers import in_one_test

PAGE = (ROOT / "docs" / "ROS2.md").read_text()
AGENT = 7
DEFAULTS = Ros2Settings()
TOPICS = {
    ODOMETRY: full_name(DEFAULTS.odometry, DEFAULTS.namespace_of(AGENT)),
    TWIST: full_name(DEFAULTS.command, DEFAULTS.namespace_of(AGENT)),
}

AHEAD: dict[str, Any] = {"linear": {"x": 1.0}, "angular": {"z": -0.5}}
SIZES: list[tuple[str, dict[str, Any], str]] = [
    (TWIST, {}, "52"),
    (TWIST_STAMPED, {"header": {"frame_id": "base_link"}}, "76"),
    (POSE_STAMPED, {"header": {"frame_id": "odom"}}, "84"),
    (ODOMETRY, {"header": {"frame_id": "odom"}, "child_frame_id": "base_link"}, "724"),
    (POSE_ARRAY, {"header": {"frame_id": "odom"}, "poses": [{}] * 3}, "28 + 56 n"),
    (CLOCK, {}, "12"),
]


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_turtles_file_is_a_boards_file(tmp_path: Path) -> None:
    """As it stands, with the topics that the commands make."""
    file = tmp_path / "turtle.toml"
    file.write_text(blocks("toml")[0])
    settings = read_settings(file)
    options = options_of(find_body(settings.body.kind), settings.body.options)
    namespace = options.namespace_of(settings.id)
    assert f"{full_name(options.odometry, namespace)} {options.odometry_type} " in PAGE
    assert f"info -v {full_name(options.command, namespace)}`" in PAGE


@pytest.mark.processes
def test_the_turtles_file_drives_a_turtle(tmp_path: Path) -> None:
    """The last two commands, with a stand-in turtle where turtlesim puts its own, and a free port for its router."""
    router = free_port()
    text = blocks("toml")[0].replace("[body.options]", f'[body.options]\nconnect = ["{endpoint(router)}"]')
    (tmp_path / "turtle.toml").write_text(text.replace(":7450", f":{free_port()}"))
    check, start = (line.split()[2:] for line in commands(PAGE)[-2:])
    board_command = [sys.executable, "-P", "-m", "deltaswarm_board"]
    done = subprocess.run([*board_command, *check], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "body: ros2" in done.stdout) == (0, True), done.stderr
    with fleet(router, "/turtle1", odometry_type=POSE_STAMPED) as robots:
        [turtle] = robots.robots
        turtle.x_m = turtle.y_m = 5.54
        with subprocess.Popen([*board_command, *start], cwd=tmp_path, stderr=subprocess.DEVNULL) as board:
            try:
                wait_until(lambda: math.dist((turtle.x_m, turtle.y_m), (5.54, 5.54)) > 1.0, "a metre of its walk")
                board.terminate()
                assert board.wait(PATIENCE_S) == 0
            finally:
                board.kill()


def test_the_followers_tables_are_of_a_boards_file() -> None:
    table = tomllib.loads(blocks("toml")[1])["body"]
    assert table["kind"] == "world"
    options_of(find_body(table["follower"]), table["options"])


def test_keys_and_tokens_are_those_of_the_code() -> None:
    node = Node(DEFAULTS.domain, "8b20917502ee955ac4476e0266340d5c", "/robot7", "deltaswarm_agent_7")
    rmw, dds, tokens, live = ([line for line in block.splitlines() if line] for block in blocks("text")[:4])
    assert rmw == [topic_key(RMW_ZENOH, DEFAULTS.domain, topic, kind) for kind, topic in TOPICS.items()]
    assert dds == [topic_key(ROS2DDS, DEFAULTS.domain, topic, kind) for kind, topic in TOPICS.items()]
    assert live == [topic_key(RMW_ZENOH, DEFAULTS.domain, topic, kind) for kind, topic in LIVE.items()]
    assert all(f"| `{kind}` | `{HASHES[kind]}` |" in PAGE for kind in LIVE)
    assert tokens == [
        node_token(node),
        endpoint_token(node, 1, PUBLISHER, TOPICS[TWIST], TWIST),
        endpoint_token(node, 2, SUBSCRIPTION, TOPICS[ODOMETRY], ODOMETRY),
    ]


@in_one_test(("message_type", "message", "size"), SIZES)
def test_every_message_has_its_hash_and_size(message_type: str, message: dict[str, Any], size: str) -> None:
    """In the tables of the page."""
    assert f"| `{message_type}` | `{HASHES[message_type]}` |" in PAGE
    name = message_type.rpartition("/")[2]
    [row] = re.findall(rf"^\| {name} \|.*\| (.*) \|$", PAGE, flags=re.MULTILINE)
    assert row == size
    assert len(encode(message_type, message)) == eval(size.replace(" n", "*3"))


def test_fields_begin_where_the_page_says() -> None:
    """In an Odometry: a byte that is not zero marks each."""
    marked: dict[str, Any] = {
        "header": {"stamp": {"sec": 1, "nanosec": 1}, "frame_id": "odom"},
        "child_frame_id": "base_link",
        "pose": {"pose": {"position": {"x": 1.0}, "orientation": {"x": 1.0}}, "covariance": [1.0] + [0.0] * 35},
        "twist": {"twist": {"linear": {"x": 1.0}, "angular": {"x": 1.0}}, "covariance": [1.0] + [0.0] * 35},
    }
    data = encode(ODOMETRY, marked)[4:]
    [row] = re.findall(r"^\| Odometry \|.*$", PAGE, flags=re.MULTILINE)
    offsets = [int(text) for text in re.findall(r"\((\d+)\)", row)]
    doubles = [at for at in range(24, len(data), 8) if data[at : at + 8] == b"\0\0\0\0\0\0\xf0\x3f"]
    assert offsets == [0, data.index(b"odom") - 4, data.index(b"base_link") - 4, *doubles]


def test_the_example_is_that_twist() -> None:
    assert bytes.fromhex(blocks("text")[4]) == encode(TWIST, AHEAD)


@in_one_test("name", Ros2Settings.__dataclass_fields__)
def test_the_page_explains_every_option(name: str) -> None:
    assert f"`{name}`" in PAGE or f"`{name} = " in PAGE or name == "listen"
