"""Commands for agents on boards: `bundle` and `certificates`."""

import argparse
import sys
from pathlib import Path
from typing import Any

from deltaswarm_cli.arguments import add_json, show
from deltaswarm_orchestrator.base.exits import OK, CommandError
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_wire import __version__
from deltaswarm_wire.arguments import agent_numbers, whole


def add_bundle(command: argparse.ArgumentParser) -> None:
    """Make a folder that installs an agent on a board, offline."""
    from deltaswarm_field.bundle import PLATFORMS, PYTHONS

    command.description = "Make a folder from which an agent is installed on a board without internet."
    command.add_argument("--platform", required=True, choices=PLATFORMS, help="platform of the board")
    command.add_argument(
        "--python",
        action="append",
        choices=PYTHONS,
        help="Python version of the board; may be repeated (default: all of these)",
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: deltaswarm-agent-VERSION-PLATFORM")
    command.add_argument(
        "--operator-key",
        type=_public_key,
        metavar="HEX",
        help="public key of the operator: into the example of a board's file; adds cryptography",
    )
    add_json(command)
    command.set_defaults(func=bundle, makes_files=True)


def _public_key(text: str) -> str:
    from deltaswarm_wire.signing import PUBLIC_KEY_RULE, is_public_key

    if not is_public_key(text):
        raise argparse.ArgumentTypeError(f"{PUBLIC_KEY_RULE} (got {text!r:.80})")
    return text


def bundle(arguments: argparse.Namespace) -> int:
    from deltaswarm_field import bundle as bundles

    out = arguments.out or Path(f"deltaswarm-agent-{__version__}-{arguments.platform}")
    check_out(out.parent, is_ours=False)
    pythons = sorted(set(arguments.python or bundles.PYTHONS), key=bundles.PYTHONS.index)
    wheels = bundles.bundle(out, arguments.platform, pythons, arguments.operator_key or "")
    show(arguments, {"folder": str(out), "wheels": wheels}, "\n".join([*(f"  {name}" for name in wheels), str(out)]))
    return OK


def add_certificates(command: argparse.ArgumentParser) -> None:
    """Make certificates for agents that reach the world over TLS."""
    command.description = (
        "Make an authority and certificates signed by it, for the world, the operator, the recorder and each agent. "
        "In an existing folder, only missing certificates are made. With --operator-key, make the key that signs the "
        "operator's commands in open air, and print its public part."
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="for NAME.pem and NAME.key")
    command.add_argument("--agents", type=agent_numbers, metavar="N-M,...", help="such as 20-24 or 3,7")
    command.add_argument(
        "--operator-key",
        type=Path,
        metavar="FILE",
        help="private key that signs commands, made if missing; prints its public part, air.operator_key of boards",
    )
    command.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the world's machine; repeatable"
    )
    command.add_argument(
        "--revoke",
        action="append",
        default=[],
        metavar="NAME",
        help="agent-N, operator or recorder: its certificate counts no more, and a new one is made; repeatable",
    )
    command.add_argument(
        "--days", type=whole(1, 36_500), default=365, metavar="N", help="how long they are valid (default: 365)"
    )
    add_json(command)
    command.set_defaults(func=certificates, makes_files=True)


def certificates(arguments: argparse.Namespace) -> int:
    from deltaswarm_orchestrator.processes.certificates import make, revoke

    agents: list[int] = arguments.agents or []
    has_certificates = arguments.out is not None and (arguments.agents is not None or bool(arguments.revoke))
    if not has_certificates and (arguments.out or agents or arguments.revoke or not arguments.operator_key):
        raise CommandError(
            "certificates need --out and --agents (or --revoke); a key for commands needs --operator-key"
        )
    if has_certificates:
        check_out(arguments.out)
    result: dict[str, Any] = {}
    lines, advice = [], []
    try:
        if arguments.operator_key:
            result["operator_key"] = public = _operator_key(arguments.operator_key)
            lines.append(f'operator_key = "{public}"')
            advice.append(f"{arguments.operator_key} signs the operator's commands; keep it on the operator's machine")
        if arguments.revoke:
            result["revoked"] = str(revoked := revoke(arguments.out, arguments.revoke))
            lines.append(str(revoked))
            advice.append(f"{revoked} counts beside ca.pem: copy it to every board, to the world and the operator")
            agents += [int(name[6:]) for name in arguments.revoke if name.startswith("agent-")]
        if has_certificates:
            files = make(arguments.out, sorted({*agents}), arguments.host, arguments.days)
            result["files"] = [str(file) for file in files]
            lines += result["files"] or [f"{arguments.out}: all certificates exist"]
            advice.append(f"{arguments.out / 'ca.key'} signs every certificate; keep it on this machine")
            advice.append("a board gets ca.pem, its own .pem and its own .key")
    except ValueError as error:
        raise CommandError(str(error)) from None
    show(arguments, result, "\n".join(lines))
    print("\n".join(advice), file=sys.stderr)
    return OK


def _operator_key(file: Path) -> str:
    """Make the key if it is missing; return its public part."""
    from deltaswarm_wire.signing import make_key, public_key

    if file.is_dir():
        raise CommandError(f"--operator-key must be a file (got the folder {file})")
    if file.exists():
        return public_key(file)
    check_out(file.parent, "--operator-key", is_ours=False)
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    return make_key(file)
