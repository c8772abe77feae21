"""What is decided about a run over many machines before anything starts."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_cluster import agents as remote_agents
from deltaswarm_cluster.agents import DaskPlacement, RemoteAgents
from deltaswarm_cluster.engine import Dask
from deltaswarm_cluster.host import ENDED, FAILED, LOG, OVER, UP, Job, News
from deltaswarm_cluster.plan import (
    ClusterError,
    Installed,
    Worker,
    WorkerLostError,
    check_installed,
    check_reached,
    divide,
    in_order,
    listen_problem,
    spans,
)
from deltaswarm_orchestrator.processes.starter import LaunchError, StoppedError
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from tests.support.tiers import in_one_test

HERE = Installed("1.2.0", "3.11", "1.10.2", "aa")
W0, W1 = Worker("w0", "tcp://10.0.0.1:1"), Worker("w1", "tcp://10.0.0.2:1")


@given(st.integers(0, 60), st.integers(1, 9))
def test_agents_are_divided_evenly_and_in_order(agents: int, workers: int) -> None:
    """Each agent once, in blocks that differ by one at most; nobody gets an empty block."""
    there = [Worker(str(number), f"tcp://10.0.0.1:{number}") for number in range(workers)]
    blocks = divide(range(agents), there)
    assert [agent for block in blocks.values() for agent in block] == list(range(agents))
    assert [*blocks] == there[: min(agents, workers)]
    sizes = [len(block) for block in blocks.values()]
    assert sizes == sorted(sizes, reverse=True)
    assert not sizes or sizes[0] - sizes[-1] <= 1


@given(st.permutations([Worker(name, f"tcp://{name}:{port}") for name in ("n2", "n10", "7", "x") for port in (9, 10)]))
def test_the_order_of_workers_does_not_depend_on_how_they_are_told(workers: list[Worker]) -> None:
    """By name and then address; numbers count by their value."""
    assert [worker.address for worker in in_order(workers)] == [
        *("tcp://7:9", "tcp://7:10", "tcp://n2:9", "tcp://n2:10", "tcp://n10:9", "tcp://n10:10", "tcp://x:9"),
        "tcp://x:10",
    ]


@pytest.mark.parametrize(
    ("agents", "text"), [([7], "agent 7"), ([0, 1, 2], "agents 0-2"), ([0, 1, 4, 6, 7], "agents 0-1, 4, 6-7")]
)
def test_agents_are_named_by_spans(agents: list[int], text: str) -> None:
    """In few words, however many they are."""
    assert spans(agents) == text


def test_a_worker_with_something_else_is_named() -> None:
    """With what it has, and what this machine has; equal ones are well."""
    check_installed(HERE, {W0: HERE, W1: HERE})
    with pytest.raises(ClusterError) as caught:
        check_installed(HERE, {W0: HERE, W1: HERE._replace(zenoh="1.9.0")})
    first, second, third = str(caught.value).splitlines()
    assert str(HERE) in first
    assert second.strip() == f"w1 at {W1.address} has deltaswarm 1.2.0 (code aa), Python 3.11, eclipse-zenoh 1.9.0"
    assert "install the same" in third
    assert "w0" not in str(caught.value)


def test_many_workers_are_not_all_named() -> None:
    """A text of a thousand lines would be read by nobody."""
    many = {Worker(str(number), f"tcp://10.0.0.1:{number}"): "refused" for number in range(1000)}
    with pytest.raises(ClusterError, match="and 995 more") as caught:
        check_reached("tls/10.0.0.9:0", many)
    assert "--listen tls/ADDRESS:PORT" in str(caught.value)
    check_reached("tls/10.0.0.9:0", dict.fromkeys(many, ""))


@in_one_test(
    ("endpoint", "is_well"),
    [
        ("tls/10.0.0.9:0", True),
        ("tls/head.cluster:7447", True),
        ("tcp/10.0.0.9:0", False),
        ("tls/0.0.0.0:0", False),
        ("tls/[::1]:0", False),
        ("tls/10.0.0.9", False),
    ],
)
def test_the_world_listens_where_agents_with_certificates_can_connect(endpoint: str, is_well: bool) -> None:
    """Over TLS, at one address."""
    assert (listen_problem(endpoint) == "") == is_well
    if not is_well:
        with pytest.raises(SettingsError, match="--listen"):
            Dask("tcp://there:8786", endpoint).check(load_scenario("smoke"))


@pytest.mark.parametrize("kind", ["kill", "freeze", "restart"])
def test_faults_that_signal_processes_are_refused(kind: str, tmp_path: Path) -> None:
    """They would have to reach processes of other machines; faults of bodies and radios do not."""
    lasts = "duration_s = 5.0" if kind == "freeze" else ""
    file = tmp_path / "faulty.toml"
    start = 'schema = 1\nname = "faulty"\n\n[[fault]]\nat_s = 3.0\nagents = [1]\n'
    file.write_text(f'{start}kind = "{kind}"\n{lasts}')
    with pytest.raises(SettingsError, match="must not signal processes"):
        Dask("tcp://there:8786").check(load_scenario(str(file)))
    file.write_text(f'{start}kind = "radio-dead"\n')
    Dask("tcp://there:8786").check(load_scenario(str(file)))


def test_no_key_is_in_a_representation() -> None:
    """Dask logs the arguments of a task that fails."""
    assert "SECRET" not in repr(Job("hybrid", 5.0, {}, "SECRET", [(3, "", "SECRET certificate", "SECRET key")]))


class Said:
    """A host that says what a test lets it say."""

    def __init__(self, worker: Worker) -> None:
        self.worker = worker
        self.pending: list[News | Exception] = [[[UP]]]
        self.calls: list[str] = []

    def start(self, job: Job) -> None:
        self.job = job

    def poll(self) -> News:
        said = self.pending.pop(0) if self.pending else []
        if isinstance(said, Exception):
            raise said
        return said

    def stop(self) -> None:
        self.calls.append("stop")
        self.pending.append([[OVER]])

    def close(self) -> None:
        self.calls.append("close")


@pytest.fixture
def hosts() -> list[Said]:
    return [Said(W0), Said(W1)]


@pytest.fixture
def cluster() -> SimpleNamespace:
    """A cluster whose problem a test sets."""
    return SimpleNamespace(problem="")


@pytest.fixture
def to_start(hosts: list[Said], cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RemoteAgents:
    """Six agents on two hosts, which are lost as soon as they seem so."""
    monkeypatch.setattr(remote_agents, "DOUBT_S", 0.0)
    blocks: Any = {hosts[0]: (0, 1, 2), hosts[1]: (3, 4, 5)}
    placement = DaskPlacement(cluster, blocks, "tls/127.0.0.1:0")
    return placement.agents(load_scenario("smoke", ["run.start_timeout_s=1"]), tmp_path)


@pytest.fixture
def agents(to_start: RemoteAgents) -> RemoteAgents:
    to_start.start("run-1", "tls/127.0.0.1:7447", ["a=1"], lambda: None)
    return to_start


def ended(agents: RemoteAgents) -> dict[str, int]:
    return {part.name: part.exit_code for part in agents.parts if part.exit_code is not None}


def test_each_host_gets_the_files_of_its_agents_alone(agents: RemoteAgents, hosts: list[Said]) -> None:
    """Each agent with its own key and settings."""
    files = [file for host in hosts for file in host.job.agents]
    assert [[agent for agent, *_ in host.job.agents] for host in hosts] == [[0, 1, 2], [3, 4, 5]]
    assert len({key for *_, key in files}) == 6
    assert len({settings for _, settings, *_ in files}) == 6, "seeds differ"
    assert all("PRIVATE KEY" in key and "CERTIFICATE" in certificate for *_, certificate, key in files)


@pytest.mark.parametrize("is_impatient", [True, False])
def test_only_hosts_that_have_started_are_asked_to_stop(
    is_impatient: bool, to_start: RemoteAgents, hosts: list[Said]
) -> None:
    """If the start is given up, by the user or after its time: a busy host is let go."""
    hosts[0].pending.clear()
    with pytest.raises(StoppedError if is_impatient else LaunchError, match=None if is_impatient else "busy"):
        to_start.start("run-1", "tls/127.0.0.1:7447", [], iter([False, is_impatient, *[False] * 999]).__next__)
    to_start.end()
    assert [host.calls for host in hosts] == [["close"], ["stop", "close"]]


LOST = WorkerLostError("it has left the cluster")


@pytest.mark.parametrize(
    ("problem", "said", "line"),
    [
        ("", LOST, f"the Dask worker {W1} was lost before it was ready with agents 3-5: it has left the cluster"),
        ("", [[FAILED, "no room"]], f"the Dask worker {W1} was lost before it was ready with agents 3-5: no room"),
        ("no link", LOST, "the Dask scheduler was lost before it was ready with all agents: no link"),
    ],
)
def test_what_is_lost_while_agents_start_is_named(
    problem: str, said: Any, line: str, to_start: RemoteAgents, hosts: list[Said], cluster: SimpleNamespace
) -> None:
    """One worker, or the scheduler; the agents that have started end."""
    cluster.problem = problem
    hosts[1].pending = [said, said]
    with pytest.raises(LaunchError, match=line):
        to_start.start("run-1", "tls/127.0.0.1:7447", [], lambda: None)
    to_start.end(at_once=True)  # waits for nobody
    assert [host.calls for host in hosts] == [["close"], ["close"]]


def test_logs_and_ends_arrive_in_pieces(agents: RemoteAgents, hosts: list[Said], tmp_path: Path) -> None:
    """A log is what has come of it so far; an exit code is its agent's."""
    hosts[0].pending += [[[LOG, 1, "one\n"]], [[LOG, 1, "two\udc99"], [ENDED, 1, -9, ""], [ENDED, 0, 0, ""]]]
    agents.look()
    agents.look()
    assert (tmp_path / "agent-1.log").read_bytes() == b"one\ntwo\x99"
    assert ended(agents) == {"agent 0": 0, "agent 1": -9}


def test_a_lost_host_has_one_line_for_all_that_ran_there(agents: RemoteAgents, hosts: list[Said]) -> None:
    """Agents that had ended before have their own; nobody asks a lost host to stop."""
    late = WorkerLostError("no answer for 30 s")
    hosts[0].pending += [[[ENDED, 1, 1, ""]], late, late]
    for _ in range(3):
        agents.look()
    lost = {part.name: part for part in agents.parts if part.exit_code is not None}
    assert {name for name, part in lost.items() if not part.ends_as_planned} == {f"the Dask worker {W0}", "agent 1"}
    line = lost[f"the Dask worker {W0}"].how_it_ended("after step 7")
    assert line == f"the Dask worker {W0} was lost after step 7 with agents 0, 2: no answer for 30 s"
    assert lost["agent 2"].how_it_ended("in step 8") == f"agent 2 was lost in step 8 with the Dask worker {W0}"
    agents.end(at_once=False)
    assert (hosts[0].calls, hosts[1].calls) == (["close"], ["stop", "close"])


def test_a_host_that_seemed_lost_and_answers_is_well(
    agents: RemoteAgents, hosts: list[Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next time it seems lost, its time begins anew."""
    monkeypatch.setattr(remote_agents, "DOUBT_S", 1.0)
    for now_s, said in ((0.0, WorkerLostError("late")), (60.0, News()), (120.0, WorkerLostError("late"))):
        monkeypatch.setattr(remote_agents, "time", SimpleNamespace(monotonic=lambda now_s=now_s: now_s))
        hosts[0].pending.append(said)
        agents.look()
    assert not ended(agents)


def test_a_lost_scheduler_takes_all_with_it(
    agents: RemoteAgents, hosts: list[Said], cluster: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one line, not one for each worker, also if it shows at a worker first."""
    monkeypatch.setattr(remote_agents, "DOUBT_S", 60.0)
    hosts[0].pending.append(WorkerLostError("cancelled"))
    agents.look()
    assert not ended(agents)
    cluster.problem = "no connection"
    agents.look()
    [line] = [part.how_it_ended() for part in agents.parts if part.exit_code is not None and not part.ends_as_planned]
    assert line == "the Dask scheduler was lost with all agents: no connection"
    assert len(ended(agents)) == 7
