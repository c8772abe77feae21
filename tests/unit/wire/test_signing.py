"""The operator's signature: what it covers, and what an agent makes of commands that are forged, altered or old."""

import stat
import sys
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.core.commands import MAX_KNOWN, CommandRelay
from deltaswarm_cli.main import main
from deltaswarm_wire.codec import MAX_STEP
from deltaswarm_wire.commands import (
    AHEAD_S,
    ALL,
    MAX_COMMAND_BYTES,
    MAX_SIGNATURE_BYTES,
    Command,
    CommandForm,
    Relayed,
    Signed,
    Target,
    decode_relayed,
    encode_command,
    encode_relayed,
)
from deltaswarm_wire.operator_messages import HEARD
from deltaswarm_wire.signing import SigningError, age_limit, is_public_key, make_key, public_key, signer, verifier

RUN = "field"
FORMS = (CommandForm("hold", (ALL,)),)


class Keys:
    """Two key pairs: the operator's, and that of somebody else."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "operator.key"
        self.public = make_key(self.file)
        self.verify = verifier(self.public, RUN)
        make_key(folder / "other.key")
        self._sign = {"operator": signer(self.file, RUN), "other": signer(folder / "other.key", RUN)}

    def relayed(self, number: int, left_steps: int = 10, life_s: float = 60.0, by: str = "operator") -> bytes:
        body = encode_command(Command(number, "hold", Target(), {}, life_s))
        return encode_relayed(Relayed(left_steps, Signed(body, self._sign[by](body))))

    def relay(self) -> CommandRelay:
        return CommandRelay(1.0, FORMS, self.verify)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Keys:
    return Keys(tmp_path_factory.mktemp("keys"))


@given(body=st.binary(max_size=MAX_COMMAND_BYTES), place=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_a_signature_holds_for_its_bytes_and_its_run_alone(keys: Keys, body: bytes, place: int, bit: int) -> None:
    signature = signer(keys.file, RUN)(body)
    assert keys.verify(Signed(body, signature))
    both = bytearray(body + signature)
    both[place % len(both)] ^= 1 << bit
    assert not keys.verify(Signed(bytes(both[: len(body)]), bytes(both[len(body) :])))
    assert not verifier(keys.public, "elsewhere")(Signed(body, signature))


@given(body=st.binary(max_size=MAX_COMMAND_BYTES), signature=st.binary(max_size=MAX_SIGNATURE_BYTES))
def test_no_bytes_at_random_are_a_signature(keys: Keys, body: bytes, signature: bytes) -> None:
    assert not keys.verify(Signed(body, signature))


def test_a_key_is_its_owners_alone(tmp_path: Path) -> None:
    """Mode 0600 from the start; never overwritten; refused once others may read it."""
    file = tmp_path / "key"
    made = make_key(file)
    assert is_public_key(made)
    assert public_key(file) == made
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    with pytest.raises(FileExistsError):
        make_key(file)
    file.chmod(0o640)
    with pytest.raises(SigningError, match="0600"):
        signer(file, RUN)


def test_what_is_no_key_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "key"
    pem = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    for data in (b"", b"no key", ec.generate_private_key(ec.SECP256R1()).private_bytes(*pem)):
        file.write_bytes(data)
        file.chmod(0o600)
        with pytest.raises(SigningError, match=str(file)):
            signer(file, RUN)
    for public in ("", "ab", "g" * 64, "\u0663" * 64, "ab" * 33):
        assert not is_public_key(public)
        with pytest.raises(SigningError):
            verifier(public, RUN)


def test_without_cryptography_the_package_is_named(keys: Keys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A board may lack it, and its user must know what to install."""
    for name in [name for name in sys.modules if name.split(".")[0] == "cryptography"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    for call in (
        lambda: make_key(tmp_path / "key"),
        lambda: signer(keys.file, RUN),
        lambda: verifier(keys.public, RUN),
    ):
        with pytest.raises(SigningError, match="pip install cryptography"):
            call()
    assert not (tmp_path / "key").exists()


def test_the_command_makes_a_key_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "keys" / "operator.key"
    for _ in range(2):
        assert main(["certificates", "--operator-key", str(file)]) == 0
        assert public_key(file) in capsys.readouterr().out
    for arguments in ([], ["--agents", "3"], ["--out", str(tmp_path / "out"), "--operator-key", str(file)]):
        assert main(["certificates", *arguments]) == 2
        assert "--out and --agents" in capsys.readouterr().err


def test_only_what_the_operator_signed_is_heard(keys: Keys) -> None:
    """And relayed. A forged command does not keep the real one of its number from being heard."""
    relay = keys.relay()
    assert relay.hear([keys.relayed(7, by="other")], 0) == []
    assert (relay.rejected, relay.due(0, 1000), relay.answers()) == (1, (), ())
    [command] = relay.hear([keys.relayed(7)], 0)
    assert command.number == 7
    assert [decode_relayed(item).signed for item in relay.due(0, 1000)] == [decode_relayed(keys.relayed(7)).signed]


@pytest.mark.parametrize("step_s", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("left_steps", [1, 10, MAX_STEP])
def test_a_relay_cannot_prolong_a_life(keys: Keys, step_s: float, left_steps: int) -> None:
    """How long a command is relayed is bounded by the life that is signed, whatever the envelope says."""
    relay = CommandRelay(step_s, FORMS, keys.verify)
    relay.hear([keys.relayed(7, left_steps, life_s=20.0)], 0)
    times = [step for step in range(1000) if relay.due(step, 1000)]
    assert max(times, default=0) * step_s <= 20.0


def test_a_command_that_is_played_again_is_old(keys: Keys) -> None:
    """Heard before, or given long before one that was heard: neither is carried out again, nor one of before."""
    relay = keys.relay()
    start = 1_700_000_000
    first, newer = keys.relayed(start), keys.relayed(start + 1000)
    assert len(relay.hear([first], 0)) == 1
    relay.note([start], [])
    assert relay.hear([first], 1) == []
    assert len(relay.hear([newer], 900)) == 1
    assert relay.hear([first, keys.relayed(start + 1)], 905) == []
    assert relay.rejected == 1
    recent = start + 1000 - int(AHEAD_S) - 50
    assert len(relay.hear([keys.relayed(recent)], 905)) == 1


def test_a_forged_number_does_not_make_others_old(keys: Keys) -> None:
    relay = keys.relay()
    relay.hear([keys.relayed(4_000_000_000, by="other")], 0)
    assert len(relay.hear([keys.relayed(5)], 0)) == 1


def test_an_agent_without_a_key_remembers_nothing(keys: Keys) -> None:
    """It refuses every command, however many come, and its memory does not grow."""
    relay = CommandRelay(1.0, FORMS, lambda _: False)
    size = _held(relay)
    for number in range(3 * MAX_KNOWN):
        assert relay.hear([keys.relayed(7) if number == 0 else _unsigned(number)], number) == []
    assert relay.rejected == 3 * MAX_KNOWN
    assert _held(relay) == size


def test_an_agent_with_a_key_remembers_so_many() -> None:
    """Also of what is signed: its number, the command, and the same by its bytes."""
    relay = CommandRelay(1.0, FORMS, lambda _: True)
    for number in range(3 * MAX_KNOWN):
        relay.hear([_unsigned(number)], 0)
    assert _held(relay) <= 3 * MAX_KNOWN
    assert {answer.state for answer in relay.answers()} == {HEARD}


def _unsigned(number: int) -> bytes:
    return encode_relayed(Relayed(10, Signed(encode_command(Command(number, "hold", Target(), {}, 60.0)))))


def _held(relay: CommandRelay) -> int:
    containers: list[Any] = [value for value in vars(relay).values() if isinstance(value, dict | set | list)]
    return sum(map(len, containers))


TEN_HOURS = 36_000
START = 1_700_000_000


@pytest.mark.parametrize("step_s", [0.1, 1.0, 5.0])
@pytest.mark.parametrize(
    ("held_s", "is_obeyed"),
    [(0, True), (50, True), (50 + AHEAD_S, True), (70 + AHEAD_S, False), (TEN_HOURS, False), (86_400, False)],
)
def test_a_relay_cannot_keep_a_command(keys: Keys, step_s: float, held_s: float, is_obeyed: bool) -> None:
    """Its age is bounded by the newest command heard and the agent's own steps since then, of whatever length."""
    relay = CommandRelay(step_s, FORMS, keys.verify)
    relay.hear([keys.relayed(START)], 100)
    kept = keys.relayed(START + 1)
    assert bool(relay.hear([kept], 100 + round((held_s + 1) / step_s))) == is_obeyed
    assert relay.rejected == (not is_obeyed)


def test_what_is_heard_late_does_not_set_the_clock_back(keys: Keys) -> None:
    """A command that comes late but within its life is obeyed; the operator's time stays what it was known to be."""
    relay = keys.relay()
    relay.hear([keys.relayed(START)], 0)
    assert relay.hear([keys.relayed(START + 10, life_s=3600.0)], 3000)
    assert not relay.hear([keys.relayed(START + 11)], 3001)


def test_a_fast_series_of_commands_is_obeyed(keys: Keys) -> None:
    """Numbers may run ahead of the operator's clock, which makes none of them old."""
    relay = keys.relay()
    for number in range(int(AHEAD_S)):
        assert relay.hear([keys.relayed(START + number)], 1)
    assert relay.hear([keys.relayed(START + int(AHEAD_S))], 2)


def test_a_board_that_has_heard_nothing_has_its_clock(keys: Keys) -> None:
    """A clock that is late, as without a battery, cannot tell how old a command is, which then is refused, too."""
    cases = {-1e9: False, -300.0: False, -200.0: True, 0.0: True, 170.0: True, 190.0: False, TEN_HOURS: False}
    for late_s, passes in cases.items():
        is_current = age_limit(lambda late_s=late_s: START + late_s)  # type: ignore[misc]
        assert is_current(decode_relayed(keys.relayed(START)).signed) == passes
