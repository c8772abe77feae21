"""What `deltaswarm certificates` makes."""

import datetime
import ipaddress
import shutil
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.processes import certificates
from tests.support.complaints import Printed

NAMES = {"ca", "world", "operator", "recorder", "agent-20", "agent-21", "agent-7"}


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def common_name(name: x509.Name) -> str:
    return str(name.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("made") / "certificates"
    hosts = ["--host", "192.168.1.10", "--host", "world.local"]
    assert main(["certificates", "--out", str(made), "--agents", "20-21,7", "--days", "30", *hosts]) == 0
    return made


def test_each_part_has_a_certificate_and_a_key(folder: Path) -> None:
    """The keys are their owner's alone, and so is the folder."""
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {path.name for path in folder.iterdir()} == {f"{name}.{end}" for name in NAMES for end in ("pem", "key")}
    assert {path.stat().st_mode & 0o777 for path in folder.glob("*.key")} == {0o600}


@pytest.mark.parametrize("name", sorted(NAMES - {"ca"}))
def test_a_certificate_carries_its_parts_name_and_the_authoritys_signature(folder: Path, name: str) -> None:
    """It signs nothing itself, begins a day ago for boards that lag, and ends when asked."""
    found, ca = certificate(folder / f"{name}.pem"), certificate(folder / "ca.pem")
    assert common_name(found.subject) == name
    found.verify_directly_issued_by(ca)
    assert not found.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert found.not_valid_after_utc - found.not_valid_before_utc == datetime.timedelta(days=31)


def test_the_worlds_certificate_is_for_its_hosts(folder: Path) -> None:
    names = certificate(folder / "world.pem").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(names.get_values_for_type(x509.DNSName)) == {"localhost", "world.local"}
    addresses = {"127.0.0.1", "::1", "192.168.1.10"}
    assert set(names.get_values_for_type(x509.IPAddress)) == {ipaddress.ip_address(text) for text in addresses}
    names = certificate(folder / "agent-7.pem").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert list(names) == [x509.DNSName("agent-7")]


def test_more_agents_are_added_and_nothing_is_made_anew(folder: Path, tmp_path: Path, capsys: Printed) -> None:
    for path in folder.iterdir():
        shutil.copy2(path, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert main(["certificates", "--out", str(tmp_path), "--agents", "7-8"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "agent-8.pem"), str(tmp_path / "agent-8.key")]
    assert all(path.read_bytes() == data for path, data in before.items())
    certificate(tmp_path / "agent-8.pem").verify_directly_issued_by(certificate(tmp_path / "ca.pem"))


def test_an_authority_whose_files_do_not_fit_is_refused(tmp_path: Path, capsys: Printed) -> None:
    certificates.make(tmp_path, [], [], 1)
    (tmp_path / "ca.key").write_bytes((tmp_path / "world.key").read_bytes())
    assert main(["certificates", "--out", str(tmp_path), "--agents", "1"]) == 2
    assert "ca.key is not the key of ca.pem" in capsys.readouterr().err


def test_an_authority_whose_key_others_may_read_signs_nothing(folder: Path, tmp_path: Path, capsys: Printed) -> None:
    certificates.make(tmp_path, [], [], 1)
    (tmp_path / "ca.key").chmod(0o644)
    assert main(["certificates", "--out", str(tmp_path), "--agents", "1"]) == 2
    assert f"chmod 600 {tmp_path}" in capsys.readouterr().err


def test_the_command_says_what_stays_on_this_machine(folder: Path, capsys: Printed) -> None:
    assert main(["certificates", "--out", str(folder), "--agents", "7"]) == 0
    printed = capsys.readouterr()
    assert str(folder / "ca.key") in printed.err
    assert str(folder / "ca.key") not in printed.out


def test_what_has_ended_is_made_anew_and_an_authority_that_has_ended_signs_nothing(
    tmp_path: Path, capsys: Printed
) -> None:
    """Else a year later all of them are there, and nobody comes in."""
    certificates.make(tmp_path, [3, 4], [], 30)
    certificates.write_pair(tmp_path / "agent-3", *certificates.Authority.load(tmp_path).sign("agent-3", -0.5))
    assert [path.name for path in certificates.make(tmp_path, [3, 4], [], 30)] == ["agent-3.pem", "agent-3.key"]
    ended = tmp_path / "ended"
    ended.mkdir()
    authority = certificates.Authority.create(0)
    certificates.write_pair(ended / "ca", authority.key, authority.certificate)
    assert main(["certificates", "--out", str(ended), "--agents", "1"]) == 2
    assert "its authority has expired" in capsys.readouterr().err


def test_no_certificate_outlives_its_authority(tmp_path: Path) -> None:
    """Else it would say that it is good for longer than anybody takes it for."""
    certificates.make(tmp_path, [3], [], 7)
    certificates.make(tmp_path, [4], [], 365)
    files = [(tmp_path / name).read_bytes() for name in ("ca.pem", "agent-4.pem")]
    assert len({x509.load_pem_x509_certificate(file).not_valid_after_utc for file in files}) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--agents", "5-3"], "'5-3'"),
        (["--agents", "-1"], "'-1'"),
        (["--agents", "x"], "'x'"),
        (["--agents", "65535"], "0 to 65534"),
        (["--agents", "1", "--days", "0"], "1 to 36500"),
    ],
)
def test_a_wrong_argument_is_refused(tmp_path: Path, arguments: list[str], message: str, capsys: Printed) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["certificates", "--out", str(tmp_path / "out"), *arguments])
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "host",
    ["", "a b", "tcp/10.0.0.1", "10.0.0.1:7447", "wörld", "192.168.1.300", "10.0.1", "-x", "x-", "a..b", "x" * 64],
)
def test_a_host_that_is_none_is_refused(tmp_path: Path, host: str, capsys: Printed) -> None:
    assert main(["certificates", "--out", str(tmp_path / "out"), "--agents", "1", f"--host={host}"]) == 2
    assert f"(got {host!r})" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_host_that_comes_later_is_added_to_the_worlds_certificate(tmp_path: Path) -> None:
    """And to the operator's, beside those that were there; the agents' stay, and the same hosts change nothing."""
    certificates.make(tmp_path, [3], ["10.0.0.1"], 30)
    before = (tmp_path / "agent-3.pem").read_bytes()
    new = certificates.make(tmp_path, [3], ["world.local", "FE80::1"], 30)
    assert {path.name for path in new} == {f"{name}.{end}" for name in ("world", "operator") for end in ("pem", "key")}
    for name in ("world", "operator"):
        hosts = {"localhost", "127.0.0.1", "::1", "10.0.0.1", "world.local", "fe80::1"}
        assert set(certificates.hosts_in(tmp_path / f"{name}.pem")) == hosts
    assert (tmp_path / "agent-3.pem").read_bytes() == before
    assert certificates.make(tmp_path, [3], ["fe80::1", "10.0.0.1"], 30) == []
