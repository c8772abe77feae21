"""The operator's signature of a command: Ed25519, by the package cryptography.

In open air any board could forge a relayed command, so a board believes only what the operator's key has signed. The
run's name is signed too: what was commanded in one run means nothing in another.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_wire.arguments import secret_problem
from deltaswarm_wire.commands import AHEAD_S, Signed, decode_command
from deltaswarm_wire.extras import missing
from deltaswarm_wire.files import write_secret
from deltaswarm_wire.keys import Keys

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

PUBLIC_KEY_BYTES = 32
PUBLIC_KEY_RULE = f"must be {2 * PUBLIC_KEY_BYTES} hexadecimal digits"

CLOCK_ERROR_S = 120.0
"""How far the clocks of operator and receiver may differ [s]."""

Sign = Callable[[bytes], bytes]


class SigningError(ValueError):
    """A key that cannot be used; the text says why and what to do."""


def is_public_key(text: str) -> bool:
    return len(text) == 2 * PUBLIC_KEY_BYTES and all(digit in "0123456789abcdef" for digit in text.lower())


def make_key(file: Path) -> str:
    """Make a key pair; write it to a new file of mode 0600 (PEM) and return the public key in hexadecimal.

    Raises:
        SigningError: the package cryptography is missing.
        OSError: the file exists, or cannot be written.
    """
    try:
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    except ImportError as error:
        raise SigningError(missing("cryptography") or str(error)) from None
    key = Ed25519PrivateKey.generate()
    pem = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    write_secret(file, pem)
    return key.public_key().public_bytes_raw().hex()


def public_key(file: Path) -> str:
    """The public part of a key file in hexadecimal; raises as `signer`."""
    return _private_key(file).public_key().public_bytes_raw().hex()


def signer(file: Path, run: str) -> Sign:
    """What signs the commands of a run by the key of a file.

    Raises:
        SigningError: the file holds no such key, others may read it, or the package cryptography is missing.
        OSError: the file cannot be read.
    """
    key, context = _private_key(file), _context(run)
    return lambda body: key.sign(context + body)


def age_limit(clock_s: Callable[[], float]) -> Callable[[Signed], bool]:
    """What tells whether a signed command is within its life by a clock of this machine [Unix s].

    Numbers of signed commands are seconds by the operator's clock. A command from the future does not pass: it shows
    that this clock is late, as after a start without a battery for it, and cannot tell how old the command is.
    """

    def is_current(signed: Signed) -> bool:
        command, now_s = decode_command(signed.body), clock_s()
        earliest_s = command.number - AHEAD_S - CLOCK_ERROR_S
        return earliest_s <= now_s <= command.number + command.life_s + CLOCK_ERROR_S

    return is_current


def verifier(public: str, run: str) -> Callable[[Signed], bool]:
    """What tells whether a command of a run is signed by the key of this public part.

    Raises:
        SigningError: it is no public key, or the package cryptography is missing.
    """
    if not is_public_key(public):
        raise SigningError(f"{PUBLIC_KEY_RULE} (got {public!r:.80})")
    try:
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    except ImportError as error:
        raise SigningError(missing("cryptography") or str(error)) from None
    key, context = Ed25519PublicKey.from_public_bytes(bytes.fromhex(public)), _context(run)

    def verify(signed: Signed) -> bool:
        try:
            key.verify(signed.signature, context + signed.body)
        except InvalidSignature:
            return False
        return True

    return verify


def _context(run: str) -> bytes:
    """What is signed before the command; no run's name has a slash."""
    return f"{Keys(run).root}/command/".encode()


def _private_key(file: Path) -> "Ed25519PrivateKey":
    try:
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    except ImportError as error:
        raise SigningError(missing("cryptography") or str(error)) from None
    if problem := secret_problem(file):
        raise SigningError(f"{file} {problem}")
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise SigningError(f"{file} must be a private key in PEM: {error}") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise SigningError(f"{file} must be an Ed25519 key (got {type(key).__name__.lstrip('_')})")
    return key
