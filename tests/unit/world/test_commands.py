"""Commands in the world's core: its frames fit whatever the base says beside what an agent hears."""

import pytest

from deltaswarm_wire.commands import BASE_ID, Turn
from deltaswarm_wire.messages import FRAME_ROOM_BYTES, MAX_POSES, decode_frame, encode_frame
from deltaswarm_world.core.turns import LIVE
from tests.support.commanding import a_command, sign
from tests.support.worlds import Stage


@pytest.mark.parametrize("jitter_s", [0.0, 3.0])
def test_a_crowded_agent_still_hears_the_base(jitter_s: float) -> None:
    """Its frame stays within the limit of the link, also where frames of the base are delayed into one step."""
    stage = Stage(120, downlink={"repeat_s": 1, "jitter_s": jitter_s}, radio={"range_m": 200})
    stage.core.turns.mode = LIVE
    many = tuple([sign(a_command(number, name="n" * 60, life_s=500)) for number in range(16)])
    heard = 0
    for step in range(30):
        frames = stage.begin()
        for frame in frames.values():
            heard += sum(sender == BASE_ID for sender, _ in frame.heard)
            full = frame._replace(poses=((0.5, 0.5),) * MAX_POSES)
            assert decode_frame(encode_frame(full)).heard == frame.heard
        if step > 0:
            assert sum(len(data) for _, data in frames[0].heard) > FRAME_ROOM_BYTES - 2000
        for agent in frames:
            stage.say(agent, b"x" * 300)
        stage.core.turns.accept(Turn(step, many if step == 1 else ()))
        stage.end()
    assert heard > 15 * 120


def test_what_the_base_says_is_in_the_digest_and_not_in_the_books_of_frames() -> None:
    """Two worlds whose agents hear different commands differ, though all else is the same."""
    digests = []
    for number in (1, 2):
        stage = Stage(3)
        stage.core.turns.mode = LIVE
        stage.core.turns.accept(Turn(0, (sign(a_command(number)),)))
        for _ in range(4):
            stage.begin()
            record = stage.end()
            assert record.frames_sent == record.frames_received == 0
        digests.append(stage.core.digest.hex())
        assert stage.core.totals(complete=True)["downlink"]["frames_heard"] == 3
    assert digests[0] != digests[1]
