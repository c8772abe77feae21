"""A run over machines with addresses of their own, joined by links with delay, one of which is cut."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.dask_clusters import Cluster, dask_cluster, nothing_is_left
from tests.support.namespaces import NEEDS_NAMESPACES, Network, network
from tests.support.swarms import RunningSwarm, run, running

pytestmark = NEEDS_NAMESPACES

HEAD, *WORKERS = range(3)
DELAY_S = 0.005
"""Each way."""

SHORT = ("--set", "run.duration_s=60")
CUT_FOR_S = 60
"""Longer than any time after which somebody gives up a link."""


@contextmanager
def on_machines(folder: Path, *arguments: str) -> Iterator[tuple[Network, Cluster, RunningSwarm]]:
    """A run with world and scheduler on one machine, and agents on two others."""
    (temporary := folder / "temporary").mkdir()
    with network(1 + len(WORKERS), DELAY_S) as net:
        inside = net.inside(HEAD)
        with dask_cluster(folder / "cluster", net.address(HEAD), inside) as cluster:
            for worker in WORKERS:
                cluster.add_worker(net.inside(worker), TMPDIR=str(temporary))
            dask = ("--engine", "dask", "--scheduler", cluster.address)
            with running(folder / "run", *dask, "--record", "off", *arguments, inside=inside) as swarm:
                yield net, cluster, swarm


def test_a_run_over_three_machines_has_the_digest_of_one_process(tmp_path: Path) -> None:
    """The world listens, without being told, at the address that the workers reach."""
    with on_machines(tmp_path, *SHORT) as (_, cluster, swarm):
        swarm.end_well()
        nothing_is_left(cluster, tmp_path)
    assert swarm.summary()["digest"] == run(tmp_path / "inside", *SHORT, "--in-process")["digest"]


def test_a_worker_whose_link_is_cut_is_lost(tmp_path: Path) -> None:
    """The others go on; what runs behind the cut ends by itself, with nobody to tell it to."""
    pace = ("--set", "run.clock=realtime", "--set", f"run.duration_s={CUT_FOR_S}")
    with on_machines(tmp_path, *pace) as (net, cluster, swarm):
        swarm.wait_for_steps(3)
        net.cut(WORKERS[1])
        errors = swarm.end_without(3, 4, 5)
        nothing_is_left(cluster, tmp_path)
    summary = swarm.summary()
    assert (summary["complete"], summary["steps"], sorted(summary["agents_lost"])) == (True, CUT_FOR_S, [3, 4, 5])
    [line] = [line for line in summary["why"] if "worker w1" in line]
    assert "was lost after step" in line
    assert "with agents 3-5" in line
    assert line in errors
