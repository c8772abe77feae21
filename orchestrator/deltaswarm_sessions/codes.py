"""Completion codes: what a participant hands in elsewhere, and what it proves.

A code is a keyed hash of the outcome and the sealed data of a session. Whoever has the key, which is in `links.json`,
can tell whose it is and whether the data are still those that it was made for.
"""

import base64
import hmac
import json
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_sessions.folder import RECORD, folder_name, read_record
from deltaswarm_sessions.links import OVER, Link, Links

CHARACTERS = 10


class Owner(NamedTuple):
    link: Link
    is_intact: bool
    """Whether the data are those that the code was made for."""


def code_of(links: Links, link: Link, folder: Path) -> str:
    """Return the code of a session that is over; `folder` is that of all sessions."""
    return _code(links.secret, link.token, link.state, _sealed(folder, link))


def owner_of(links: Links, code: str, folder: Path) -> Owner | None:
    """Return whose code it is; None: nobody's, or its data have changed since.

    The second part of a code is of the link alone, so that it is known even then.
    """
    given = code.strip().upper().replace(" ", "")
    for link in links.links:
        for state in OVER:
            whole = _code(links.secret, link.token, state, _sealed(folder, link))
            if hmac.compare_digest(given.encode(), whole.encode()):
                return Owner(link, True)
            if hmac.compare_digest(given.partition("-")[2].encode(), whole.partition("-")[2].encode()):
                return Owner(link, False)
    return None


def _code(secret: str, token: str, state: str, data: str) -> str:
    """Return a code in two parts: one proves the data, the other tells whose it is."""

    def part(*values: str) -> str:
        digest = hmac.digest(secret.encode(), json.dumps(values).encode(), "sha256")
        return base64.b32encode(digest)[:CHARACTERS].decode()

    return f"{part(token, state, data)}-{part(token)}"


def _sealed(folder: Path, link: Link) -> str:
    """Return what stands for the data of a session: its record, which seals all files; empty: there are none."""
    if link.number is None:
        return ""
    record = folder / folder_name(link.number) / RECORD
    if not record.exists():
        return ""
    try:
        done = [attempt["folder"] for run in read_record(record.parent)["runs"] for attempt in run["attempts"]]
        for name in done:  # the record seals their manifests, and they seal what the runs wrote
            if (record.parent / name).exists():
                seal.checked(record.parent / name / seal.MANIFEST)
    except CommandError:
        return "changed"
    return sha256(record.read_bytes()).hexdigest()
