"""A run whose last agent is a board: it joins the world over TLS with a certificate, the others over loopback."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.processes import certificates
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_wire.session import PASSWORD_VARIABLE, Tls
from tests.support.swarms import PATIENCE_S, run

SETTINGS = ("record=off", "run.duration_s=60")
BOARD = 5
"""The last agent of the scenario `smoke`."""


def tls_files(folder: Path, name: str) -> Tls:
    """What `deltaswarm certificates` wrote for a name."""
    return Tls(str(folder / "ca.pem"), str(folder / f"{name}.pem"), str(folder / f"{name}.key"))


def tls_arguments(folder: Path, name: str) -> list[str]:
    """The same as arguments of a part."""
    files = tls_files(folder, name)
    return ["--ca", files.ca, "--certificate", files.certificate, "--key", files.key]


def tls_table(folder: Path, name: str, **more: bool) -> dict[str, Any]:
    """The same as a table of a board's file."""
    files = tls_files(folder, name)
    return {"ca_file": files.ca, "cert_file": files.certificate, "key_file": files.key, **more}


def run_with_board(folder: Path, board: Sequence[str], environment: Mapping[str, str]) -> Outcome:
    """A short run by processes; `board` is the command that starts an agent there."""
    scenario = load_scenario("smoke", SETTINGS)
    (folder / "scenario.toml").write_text(to_toml(scenario))
    keys = folder / "certificates"
    certificates.make(keys, [BOARD], [], 1)
    python = [sys.executable, "-P", "-m"]
    out, credentials = folder / "out", folder / "credentials"
    world = [*python, "deltaswarm_world", "--scenario", str(folder / "scenario.toml"), "--out", str(out)]
    world += ["--run", "field", "--credentials", str(credentials), *tls_arguments(keys, "world")]
    world += ["--listen", "tcp/127.0.0.1:0", "--listen", "tls/127.0.0.1:0"]
    with ExitStack() as stack:

        def start(command: Sequence[str], **variables: str) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                command, env={**os.environ, **variables}, cwd=folder, stdout=subprocess.PIPE, text=True
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        def settings_of(agent: int) -> list[str]:
            return ["--settings", str(out / "agents" / f"{agent}.toml")]

        parts = [start(world)]
        assert parts[0].stdout is not None
        local, over_tls = parts[0].stdout.readline().split()
        passwords = dict(line.split(":", 1) for line in credentials.read_text().splitlines())
        near = ["--run", "field", "--low-latency", "--connect", local]
        operator = [*python, "deltaswarm_operator", "--out", str(out), *near]
        parts.append(start(operator, **{PASSWORD_VARIABLE: passwords["operator"]}))
        for agent in range(BOARD):
            command = [*python, "deltaswarm_agent", "--id", str(agent), *settings_of(agent), *near]
            parts.append(start(command, **{PASSWORD_VARIABLE: passwords[f"agent-{agent}"]}))
        command = [*board, "--id", str(BOARD), *settings_of(BOARD), "--run", "field", "--connect", over_tls]
        parts.append(start([*command, *tls_arguments(keys, f"agent-{BOARD}")], **environment))
        assert [part.wait(PATIENCE_S) for part in parts] == [0] * len(parts)
    return run_tables.read_outcome(out)


def usual_digest(folder: Path) -> str:
    """The digest of the same run in one process."""
    arguments = [argument for setting in SETTINGS for argument in ("--set", setting)]
    return str(run(folder / "inside", "--in-process", *arguments)["digest"])
