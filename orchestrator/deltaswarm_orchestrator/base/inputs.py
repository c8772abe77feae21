"""Identify the files that decide a run, once before the first run; check them when a run begins and ends."""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.plugins import CONTROLLERS, find_controller

CODE = "the code of deltaswarm"

Inputs = Mapping[str, str]
"""Digests of files, by what each file is to a run."""


class InputsChangedError(CommandError):
    """A file that decides a run has changed since it was identified."""

    code = FAILED


def identify(scenario: Scenario) -> Inputs:
    """Return the inputs of a scenario's runs: modules as this process has loaded them, other files as they are now.

    The scenario itself, with the language of its page, has been read by now and is not read again.
    """
    files = {name: file.read_bytes() if loaded is None else loaded for name, file, loaded in _files(scenario)}
    return {CODE: provenance.code_digest(), **{name: digest(content) for name, content in files.items()}}


def check(scenario: Scenario, identified: Inputs, *, starts_python: bool) -> None:
    """Check that the inputs of a run are those that `identify` returned, on disk and as this process has loaded them.

    `starts_python` says that the run starts processes, which load deltaswarm anew.
    """
    changed = [
        name if str(file) in name else f"{name} ({file})"
        for name, file, loaded in _files(scenario)
        if {digest(content) for content in (loaded, _content(file)) if content is not None} != {identified.get(name)}
    ]
    codes = {provenance.code_digest(), *([provenance.code_digest.__wrapped__()] if starts_python else [])}
    if codes != {identified[CODE]}:
        changed.append(CODE)
    if changed:
        raise InputsChangedError(
            f"all runs must use the same files, but these are not as they were first read: {', '.join(changed)}; "
            "no run with others is used: undo the change, or begin anew"
        )


def of_controller(mode: str) -> dict[str, str]:
    """Return the inputs of the controller that `control.mode` names, as on this machine's disk; {} if there is none."""
    try:
        point = () if mode in CONTROLLERS.shipped else _files_of(find_controller(mode))
        return {name: digest(_content(file)) for name, file, _ in point}
    except SettingsError:
        return {}


def differences(was: Mapping[str, Any], now: Inputs) -> str:
    """Name the inputs that differ from those in a manifest; "" if all are equal or the manifest has none."""
    return ", ".join(name for name in {**was, **now} if was and was.get(name) != now.get(name))


def why_other(manifest: Mapping[str, Any], scenario: Scenario) -> str:
    """Say why a run does not repeat: which inputs have changed since it began, or that it was disturbed."""
    was = manifest.get("inputs", {})
    if changed := differences(was, identify(scenario)):
        return f"changed since then: {changed}"
    return "it was disturbed" if was else "it was disturbed, or made by another version"


def _files(scenario: Scenario) -> Iterator[tuple[str, Path, bytes | None]]:
    """Yield what each file is to a run, its path, and of a module the content that this process has loaded."""
    for _, _, _, cls in provenance.extensions(scenario):
        yield from _files_of(cls)
    if scenario.events.density.kind == "grid":
        yield f"grid {scenario.events.density.file}", Path(scenario.events.density.file), None


def _files_of(cls: Any) -> Iterator[tuple[str, Path, bytes | None]]:
    for name, (file, loaded) in provenance.modules_of(cls).items():
        yield f"module {name}", file, loaded
    for name, file in provenance.data_of(cls).items():
        yield f"{name} of {cls.__module__}", file, None


def _content(file: Path) -> bytes:
    """Return the content of a file; empty if it is gone."""
    try:
        return file.read_bytes()
    except OSError:
        return b""


def digest(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=8).hexdigest()
