"""Zenoh's access-control rules; what they do not allow is denied.

At the world's router they enforce radio range: an agent may send on its own keys and receive its own frame, nothing
else. Every client receives from the world only, so the router's one thread never waits for room on a link in order to
forward another client's sample, which would block it. In open air each end has its own rules, by which no process can
impersonate another. A process is identified by user name and password or, over TLS, only by the name in its
certificate.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_wire.commands import BASE_ID
from deltaswarm_wire.keys import ACT, AGENT, FRAME, HEALTH, OPERATOR, RADIO, RECORDER, REPORT, TAKEN, WORLD, Keys
from deltaswarm_wire.reading import read_text

TLS = "tls"
REVOKED = "revoked.txt"

CERTIFIED = re.compile(rf"({AGENT}-[0-9]+|{WORLD}|{OPERATOR}|{RECORDER})(\.[0-9]+)?")
"""The name of a user in a certificate."""


def user_name(role: str, number: int = 0) -> str:
    return f"agent-{number}" if role == AGENT else role


def revoked_beside(ca: str) -> frozenset[str]:
    """Read the names of revoked certificates: one per line in `revoked.txt`, beside the authority's certificate."""
    file = Path(ca).with_name(REVOKED)
    try:
        lines = read_text(file).splitlines()
    except FileNotFoundError:
        return frozenset()
    except (OSError, ValueError) as error:
        raise ValueError(f"{file} cannot be read: {error}") from None
    names = {number: line.strip() for number, line in enumerate(lines, 1) if line.strip()}
    for number, name in names.items():
        if not is_certified(name):
            raise ValueError(f"{file} line {number} must be a name such as agent-3 or operator.2 (got {name!r:.80})")
    return frozenset(names.values())


def is_certified(name: str) -> bool:
    """Whether a name can stand in a certificate: that of an agent, the world, the operator or the recorder."""
    return CERTIFIED.fullmatch(name) is not None


def certified_name(user: str, revoked: Collection[str]) -> str:
    """The name in a user's certificate: `agent-3` or, where that is revoked, `agent-3.2` and so on."""
    return next(name for n in count(1) if (name := user if n == 1 else f"{user}.{n}") not in revoked)


def world_rules(
    keys: Keys, agents: Iterable[int], named_over: Sequence[str] | None = None, revoked: Collection[str] = ()
) -> dict[str, Any]:
    """Build Zenoh's `access_control` for the router: what each user may send and receive.

    `named_over` lists the protocols over which user names identify clients; over TLS, certificate names do, unless they
    are `revoked`.

    A client's publisher stays silent until it learns of a matching subscription from the router, so the subscribers'
    own key expressions must pass outwards (`declare_subscriber`, egress). The operator receives reports only from
    the world, never directly from an agent.
    """
    book = _RuleBook(named_over, revoked)
    world = keys.token(WORLD)
    for agent in agents:
        name = user_name(AGENT, agent)
        publishes = [keys.agent(agent, leaf) for leaf in (RADIO, REPORT, ACT, TAKEN)]
        inbox = keys.agent(agent, FRAME)
        book.allow(name, _Traffic(publishes, [inbox], [keys.from_agents], keys.token(AGENT, agent), world))
    operator = _Traffic(
        sends=[keys.workload, keys.taken(OPERATOR), keys.turn, keys.pace],
        receives=[keys.forwarded, keys.clock],
        heard_by=[keys.workload, keys.all_taken, keys.turn, keys.pace],
        token=keys.token(OPERATOR),
        watches=keys.all_tokens,
    )
    recorder = _Traffic(
        sends=[keys.done, keys.taken(RECORDER)],
        receives=[keys.clock, keys.truth, keys.wire, keys.status, keys.counted, keys.orders, keys.forwarded],
        heard_by=[keys.done, keys.all_taken],
        token=keys.token(RECORDER),
        watches=keys.all_tokens,
    )
    book.allow(OPERATOR, operator)
    book.allow(RECORDER, recorder)
    return book.access_control()


def air_rules(keys: Keys, agents: Iterable[int], revoked: Collection[str]) -> dict[str, Any]:
    """Build the same for a board or an operator in open air with TLS links, for these agents.

    An agent sends only its own samples; the operator, which may be a router, also forwards those of others. So only the
    operator sends the base's radio frames.
    """
    book = _RuleBook((), revoked)
    heard = [keys.all_radio, keys.all_reports, keys.all_health]
    names = {user_name(AGENT, agent): agent for agent in agents if agent != BASE_ID}
    for name, agent in names.items():
        publishes = [keys.agent(agent, leaf) for leaf in (RADIO, REPORT, HEALTH)]
        book.allow(name, _Traffic(publishes, token=keys.token(AGENT, agent)))
    # One rule for all agents: one rule each would cost a board 3 MB for 25 agents.
    agents_traffic = _Traffic(receives=[keys.all_radio], heard_by=heard, watched_by=keys.token(AGENT, "*"))
    book.allow("agents", agents_traffic, names=[*names])
    book.allow(OPERATOR, _Traffic([keys.all_radio], heard, [keys.all_radio], watches=keys.token(AGENT, "*")))
    return book.access_control()


class _Traffic(NamedTuple):
    """A user's key expressions: samples, its own token, the tokens it watches, and its tokens that we watch."""

    sends: Sequence[str] = ()
    receives: Sequence[str] = ()
    heard_by: Sequence[str] = ()
    token: str = ""
    watches: str = ""
    watched_by: str = ""


class _RuleBook:
    def __init__(self, named_over: Sequence[str] | None, revoked: Collection[str]) -> None:
        self._named_over = named_over
        self._revoked = revoked
        self._rules: list[dict[str, Any]] = []
        self._policies: list[dict[str, Any]] = []
        self._subjects: list[dict[str, Any]] = []

    def allow(self, user: str, traffic: _Traffic, names: Sequence[str] = ()) -> None:
        """Allow the traffic with a user, or with several users of these names."""
        subjects = self._subjects_of(user, [*names] or [user])
        self._subjects += subjects
        watching = ["declare_liveliness_subscriber", "liveliness_query"]
        rules = [
            self._rule(f"{user}-sends", ["put"], ["ingress"], traffic.sends),
            self._rule(f"{user}-receives", ["put"], ["egress"], traffic.receives),
            self._rule(f"{user}-subscribes", ["declare_subscriber"], ["ingress"], traffic.receives),
            self._rule(f"{user}-is-heard", ["declare_subscriber"], ["egress"], traffic.heard_by),
            self._rule(f"{user}-lives", ["liveliness_token"], ["ingress"], [traffic.token]),
            self._rule(f"{user}-watches", watching, ["ingress"], [traffic.watches]),
            self._rule(f"{user}-sees", ["liveliness_token"], ["egress"], [traffic.watches]),
            self._rule(f"{user}-is-watched", watching, ["egress"], [traffic.watched_by]),
        ]
        ids = [subject["id"] for subject in subjects]
        self._policies.append({"rules": [rule for rule in rules if rule], "subjects": ids})

    def _subjects_of(self, user: str, names: list[str]) -> list[dict[str, Any]]:
        """Zenoh requires all criteria of a subject to match, so user name and certificate are two subjects."""
        if self._named_over is None:
            return [{"id": user, "usernames": names}]
        certificates = [certified_name(name, self._revoked) for name in names]
        certified = {"id": f"{user}-certified", "cert_common_names": certificates, "link_protocols": [TLS]}
        if not self._named_over:
            return [certified]
        return [certified, {"id": user, "usernames": names, "link_protocols": list(self._named_over)}]

    def _rule(self, name: str, messages: list[str], flows: list[str], key_exprs: Sequence[str]) -> str:
        if not any(key_exprs):
            return ""
        self._rules.append(
            {"id": name, "permission": "allow", "messages": messages, "flows": flows, "key_exprs": [*key_exprs]}
        )
        return name

    def access_control(self) -> dict[str, Any]:
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": self._rules,
            "subjects": self._subjects,
            "policies": self._policies,
        }
