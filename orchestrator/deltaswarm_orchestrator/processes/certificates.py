"""Certificates for agents on boards: an authority, and certificates for world, operator, recorder and each agent.

The world's access control goes by the name in a certificate: `agent-3` may act only as agent 3.
"""

import datetime
import ipaddress
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from deltaswarm_wire.access import REVOKED, certified_name, is_certified, revoked_beside, user_name
from deltaswarm_wire.arguments import secret_problem
from deltaswarm_wire.files import write_whole
from deltaswarm_wire.keys import AGENT, OPERATOR, RECORDER, WORLD

CA = "ca"
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
LABEL = re.compile(r"[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?")
"""One part of a host's name (RFC 1123)."""

MAX_HOST = 253
"""Characters of a host's name."""

CLOCK_SLACK = datetime.timedelta(days=1)
"""Certificates are valid this long before now, because a board without a real-time clock may lag behind."""

KEY_USAGES = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"),
    *("key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)

Key = ec.EllipticCurvePrivateKey


class Authority:
    """Signs certificates; its key is in memory, or in the folder's `ca.key`."""

    def __init__(self, key: Key, certificate: x509.Certificate) -> None:
        self.key = key
        self.certificate = certificate

    @classmethod
    def create(cls, days: int) -> "Authority":
        key = ec.generate_private_key(ec.SECP256R1())
        name = _name("deltaswarm CA")
        signing = x509.KeyUsage(**{usage: usage in ("key_cert_sign", "crl_sign") for usage in KEY_USAGES})
        builder = (
            _builder(name, name, key, days)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(signing, critical=True)
        )
        return cls(key, builder.sign(key, hashes.SHA256()))

    @classmethod
    def load(cls, folder: Path) -> "Authority":
        """Load the authority from a folder that `make` filled before."""
        certificate = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
        if problem := secret_problem(folder / "ca.key"):
            raise ValueError(f"{folder / 'ca.key'} {problem}")
        try:
            key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), password=None)
        except TypeError as error:
            raise ValueError(f"{folder / 'ca.key'}: {error}") from None
        if not isinstance(key, Key) or key.public_key() != certificate.public_key():
            raise ValueError(f"{folder}: ca.key is not the key of ca.pem")
        return cls(key, certificate)

    def sign(self, name: str, days: float, hosts: Sequence[str] = ()) -> tuple[Key, x509.Certificate]:
        """Make a key and a certificate for this many days, or until the authority ends.

        Without hosts, `name` is the host, as of boards as peers.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        usages = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        names = x509.SubjectAlternativeName([check_host(host) for host in hosts or (name,)])
        builder = (
            _builder(_name(name), self.certificate.subject, key, days, self.certificate.not_valid_after_utc)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
            .add_extension(names, critical=False)
        )
        return key, builder.sign(self.key, hashes.SHA256())


def make(folder: Path, agents: Iterable[int], hosts: Sequence[str], days: int) -> list[Path]:
    """Write `NAME.pem` and `NAME.key` for ca, world, operator, recorder and each agent; return the new files.

    In a folder with an authority, existing certificates stay. Only a certificate that has expired, or that is the
    world's or the operator's and lacks one of the hosts, is replaced. Keys have mode 0600, a new folder 0700.

    Raises:
        ValueError: a host is not a name or address, or the authority's files do not match or have expired.
        OSError: the folder cannot be written.
    """
    server = tuple(dict.fromkeys(str(check_host(host).value) for host in (*LOCAL_HOSTS, *hosts)))
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    new: list[str] = []
    if (folder / "ca.pem").exists():
        authority = Authority.load(folder)
        if _has_ended(folder / "ca.pem"):
            raise ValueError(f"{folder}: its authority has expired; make certificates in a new folder")
    else:
        authority = Authority.create(days)
        write_pair(folder / CA, authority.key, authority.certificate)
        new.append(CA)
    revoked = revoked_beside(str(folder / "ca.pem"))
    for user in (WORLD, OPERATOR, RECORDER, *(user_name(AGENT, agent) for agent in agents)):
        path = folder / f"{user}.pem"
        wanted = server if user in (WORLD, OPERATOR) else (user,)
        known = hosts_in(path) if user in (WORLD, OPERATOR) and path.exists() else ()
        name = certified_name(user, revoked)
        is_of_use = path.exists() and _name_in(path) == name and not _has_ended(path)
        if not is_of_use or (known and not {*wanted} <= {*known}):
            write_pair(folder / user, *authority.sign(name, days, tuple(dict.fromkeys((*wanted, *known)))))
            new.append(user)
    return [folder / f"{name}.{ending}" for name in new for ending in ("pem", "key")]


def revoke(folder: Path, users: Iterable[str]) -> Path:
    """Add the names in the present certificates of some users to the list of revoked ones; return its file.

    `make` makes new certificates for them, with other names. The list counts where it lies beside `ca.pem`, from the
    next start on.

    Raises:
        ValueError: a user has no certificate in the folder.
        OSError: the list cannot be written.
    """
    revoked = revoked_beside(str(folder / "ca.pem"))
    for user in users:
        if user == WORLD or not is_certified(user) or not (folder / f"{user}.pem").exists():
            raise ValueError(
                f"--revoke must be an agent, operator or recorder with a certificate in {folder} (got {user})"
            )
        revoked |= {_name_in(folder / f"{user}.pem")}
    write_whole(folder / REVOKED, "".join(f"{name}\n" for name in sorted(revoked)).encode())
    return folder / REVOKED


def _has_ended(path: Path) -> bool:
    now = datetime.datetime.now(datetime.UTC)
    return x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc < now


def _name_in(path: Path) -> str:
    subject = x509.load_pem_x509_certificate(path.read_bytes()).subject
    return str(subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def hosts_in(path: Path) -> tuple[str, ...]:
    """Return the names and addresses that a certificate is for."""
    extensions = x509.load_pem_x509_certificate(path.read_bytes()).extensions
    names = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(name.value) for name in names)


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def check_host(text: str) -> x509.GeneralName:
    """Return a host as certificates name it.

    Raises:
        ValueError: it is not a name or address.
    """
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        pass
    is_number = text.rpartition(".")[2].isdecimal()  # the last label of a name is none, so this is no address
    if is_number or len(text) > MAX_HOST or not all(map(LABEL.fullmatch, text.split("."))):
        raise ValueError(f"--host must be a name or an IP address (got {text!r})")
    return x509.DNSName(text)


AS_LONG = datetime.timedelta(minutes=1)
"""A certificate may outlive its authority by this much, so that those made with it are for as many days."""


def _builder(
    subject: x509.Name, issuer: x509.Name, key: Key, days: float, until: datetime.datetime | None = None
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(days=days)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SLACK)
        .not_valid_after(end if until is None or end - until < AS_LONG else until)
    )


def pem_of(key: Key, certificate: x509.Certificate) -> tuple[bytes, bytes]:
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    return secret, certificate.public_bytes(pem)


def write_pair(stem: Path, key: Key, certificate: x509.Certificate) -> None:
    """Write the key before the certificate, so that every certificate has its key."""
    secret, public = pem_of(key, certificate)
    write_whole(stem.with_name(f"{stem.name}.key"), secret, 0o600)
    write_whole(stem.with_name(f"{stem.name}.pem"), public, 0o644)
