"""What may differ in a branch: keys of the scenario, what becomes of them, and what of later orders. Pure."""

from typing import NamedTuple

from deltaswarm_wire.checked import Problem

KEPT, DROPPED, DECIDED = "kept", "dropped", "decided"
LATER = (KEPT, DROPPED, DECIDED)
"""What becomes of the orders after the branching point: given in the same steps, not given, or decided anew."""


class KeyRule(NamedTuple):
    """What holds for all keys that begin with a prefix; the longest prefix counts."""

    prefix: str
    may_differ: bool
    why: str
    """What becomes of another value; or why there can be none."""


WORLD = "the world of a branch is that of its parent"
PAGE = "nobody is at the page of a branch"

RULES = (
    KeyRule("control", True, "every controller starts anew in that step; agents stay where they are"),
    KeyRule(
        "operator.threshold_hz",
        True,
        "rules, and the time above the threshold, follow it from that step on; the longest such time and the share of "
        "minutes are judged by it for the whole run",
    ),
    KeyRule("operator.person", True, "the simulated person goes on with these, or comes or leaves"),
    KeyRule("operator.autonomy", True, "the rule starts anew, with the delta that was ordered last"),
    KeyRule("operator.budget", True, "the rule starts anew, with the structure that was ordered last"),
    KeyRule("operator.inbox", True, "the policy gets what is held back; severities hold for what arrives"),
    KeyRule("operator.more_thresholds_hz", False, PAGE),
    KeyRule("operator.page", False, PAGE),
    KeyRule("operator.probes", False, "the times of all questions are drawn before the first step"),
    KeyRule("operator.task", False, "events keep their classes"),
    KeyRule("command", False, "orders are changed by --add-command and --drop-command"),
    KeyRule("seed", False, "a branch has the random draws of its parent; --replicates makes others"),
    KeyRule("run", False, "a branch has the steps and the pace of its parent"),
    KeyRule("metrics", False, "a branch is measured as its parent is"),
    *(KeyRule(prefix, False, WORLD) for prefix in ("arena", "world", "events", "agents", "fault")),
    *(
        KeyRule(prefix, False, "frames are under way, and links have made their draws")
        for prefix in ("radio", "uplink", "downlink")
    ),
    *(KeyRule(prefix, False, "it says how a run is kept, not what happens in it") for prefix in ("schema", "name")),
    KeyRule("record", False, "a branch is recorded as its parent is"),
)


def rule_of(key: str) -> KeyRule | None:
    """Return the rule for a dotted key; None if no key of a scenario begins like this."""
    fitting = [rule for rule in RULES if f"{key}.".startswith((f"{rule.prefix}.", f"{rule.prefix}["))]
    return max(fitting, key=lambda rule: len(rule.prefix), default=None)


def problem_of(key: str) -> Problem | None:
    """Say why a key cannot differ in a branch; None if it can, or if there is no such key at all."""
    rule = rule_of(key)
    if rule is None or rule.may_differ:
        return None
    return Problem("--set", key, f"must be a key that can change within a run: {rule.why}")
