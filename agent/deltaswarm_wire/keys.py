"""The key expressions of a run, below `deltaswarm/<run>/`."""

import re

from deltaswarm_wire.codec import MAX_AGENT_ID

ROOT = "deltaswarm"

FRAME, RADIO, REPORT, ACT, HEALTH, TAKEN = "frame", "radio", "report", "act", "health", "taken"

WORLD, OPERATOR, RECORDER, AGENT = "world", "operator", "recorder", "agent"

RUN_NAME_RULE = "must be 1 to 64 letters, digits, '_', '.' or '-'"

_RUN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class Keys:
    """All keys of one run. A run's name is one chunk: letters, digits, `_`, `.`, `-`."""

    def __init__(self, run: str) -> None:
        if not _RUN_NAME.fullmatch(run):
            raise ValueError(f"run name {RUN_NAME_RULE} (got {run!r})")
        self.run = run
        self.root = f"{ROOT}/{run}"
        self.clock = f"{self.root}/clock"
        self.truth = f"{self.root}/world/truth"
        self.status = f"{self.root}/world/status"
        self.orders = f"{self.root}/world/orders"
        self.wire = f"{self.root}/world/wire"
        self.forwarded = f"{self.root}/world/report"
        self.done = f"{self.root}/recorder/done"
        self.workload = f"{self.root}/operator/workload"
        self.counted = f"{self.root}/world/workload"
        self.turn = f"{self.root}/operator/turn"
        self.pace = f"{self.root}/operator/pace"
        self.all_taken = self.taken("*")
        self.from_agents = self.agent("*", "*")
        self.all_radio = self.agent("*", RADIO)
        self.all_reports = self.agent("*", REPORT)
        self.all_health = self.agent("*", HEALTH)
        self.all_acts = self.agent("*", ACT)
        self.all_tokens = f"{self.root}/@lv/*/*"

    def agent(self, agent: int | str, leaf: str) -> str:
        """`agent/<id>/<leaf>`; leaf is one of FRAME, RADIO, REPORT, ACT, HEALTH, TAKEN, or `*`."""
        return f"{self.root}/agent/{agent}/{leaf}"

    def taken(self, role: str) -> str:
        """The key on which operator and recorder confirm the steps that they have."""
        return f"{self.root}/{role}/{TAKEN}"

    def token(self, role: str, number: int | str = 0) -> str:
        """The liveliness token of one process."""
        return f"{self.root}/@lv/{role}/{number}"


def parse_agent_key(key: str) -> tuple[int, str] | None:
    """Agent and leaf of `.../agent/<id>/<leaf>`, or None for any other key."""
    chunks = key.rsplit("/", 3)
    number = _number(chunks[2]) if len(chunks) == 4 and chunks[1] == AGENT else None
    return None if number is None else (number, chunks[3])


def parse_token(key: str) -> tuple[str, int] | None:
    """Role and number of `.../@lv/<role>/<number>`, or None for any other key."""
    chunks = key.rsplit("/", 3)
    number = _number(chunks[3]) if len(chunks) == 4 and chunks[1] == "@lv" else None
    return None if number is None else (chunks[2], number)


def _number(chunk: str) -> int | None:
    """Parse an agent's number in canonical form: ASCII digits, no leading zero."""
    if not (chunk.isascii() and chunk.isdecimal()) or len(chunk) > 5 or (chunk[0] == "0" and chunk != "0"):
        return None
    number = int(chunk)
    return number if number <= MAX_AGENT_ID else None
