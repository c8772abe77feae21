"""The page on runs over many machines: its commands work, and its tables say what the code has."""

import ast
import json
import re
import shlex
from pathlib import Path

import pytest

from deltaswarm_cli.run import EXCLUDES
from tests.support.dask_clusters import Cluster, dask_cluster
from tests.support.pages import ROOT, commands, shell

PAGE = (ROOT / "docs" / "SCALE.md").read_text()
SCHEDULER, WORKER, RUN = commands(PAGE)


@pytest.mark.slow
@pytest.mark.processes
def test_the_commands_for_a_cluster_and_a_run_work(tmp_path: Path) -> None:
    """Those of Dask, with free ports instead of 8786 and this machine as HEAD, and a run of a few steps."""
    with dask_cluster(tmp_path / "cluster") as cluster:
        assert shlex.split(SCHEDULER) == ["dask", "scheduler", "--port", "8786"]
        assert shlex.split(WORKER) == ["dask", "worker", "tcp://HEAD:8786", *Cluster.WORKER_OPTIONS]
        cluster.add_worker()
        run = RUN.replace("tcp://HEAD:8786", cluster.address)
        short = "--set run.duration_s=20 --set agents.count=6 --json"
        done = shell(f"{run} {short}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["valid"]


def test_what_is_refused_is_in_the_table() -> None:
    table = PAGE[PAGE.index("## What is refused") : PAGE.index("## When a worker is lost")]
    others, _ = EXCLUDES["engine"]
    for name in (*others, "resume"):
        assert f"`--{name.replace('_', '-')}`" in table, name


def test_the_deployers_are_python_and_known() -> None:
    """Each block is whole; those of Dask itself can be imported."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    assert len(blocks) == 4
    for block in blocks:
        ast.parse(block)
    from dask.distributed import LocalCluster, SSHCluster

    assert LocalCluster.__name__ in blocks[0]
    assert SSHCluster.__name__ in blocks[1]
