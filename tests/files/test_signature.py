"""Signatures find authors: of another key, of another bundle, damaged, or missing, they are refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("cryptography", reason="the package cryptography, of the extra 'sign', is needed to sign")

from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.rsa import generate_private_key

from bundles import make_bundle, make_contract, repair_sums
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.bundle import SIGNATURE, SUMS, read_bundle
from stiction.files.signature import PRIME, SMALL_ORDER, check_signature, fingerprint, make_key, sign

SECRET = bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
OF_NOTHING = bytes.fromhex(
    "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b"
)
"""The first example of RFC 8032, section 7.1: secret key, public key, signature of the empty message."""


def pem(key: Ed25519PrivateKey, path: Path, passphrase: bytes | None = None) -> Path:
    """Write a private key."""
    hidden = form.BestAvailableEncryption(passphrase) if passphrase else form.NoEncryption()
    path.write_bytes(key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, hidden))
    return path


def public(key: Ed25519PrivateKey, path: Path) -> Path:
    """Write its public key."""
    path.write_bytes(key.public_key().public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo))
    return path


def no_passphrase() -> str:
    """Stands for a terminal at which nobody may be asked."""
    raise AssertionError("a passphrase was asked for")


@pytest.fixture
def keys(tmp_path: Path) -> tuple[Path, Path]:
    """A private and a public key."""
    private = tmp_path / "maker.pem"
    return private, make_key(private)


def test_it_is_the_signature_of_the_standard(tmp_path: Path) -> None:
    """RFC 8032's own example, and the fingerprint by hand: SHA-256 of its public key begins with 21fe31df."""
    key = Ed25519PrivateKey.from_private_bytes(SECRET)
    signature, by = sign(b"", pem(key, tmp_path / "key.pem"), no_passphrase)
    assert signature == OF_NOTHING and by == "21fe31dfa154a261626bf854046fd227"
    assert check_signature(b"", OF_NOTHING, public(key, tmp_path / "key.pub")) == by == fingerprint(key.public_key())


def test_a_signed_bundle_is_verified_by_its_makers_key(
    bundle: Path, keys: tuple[Path, Path], capsys: pytest.CaptureFixture
) -> None:
    """The digest stays; signing again changes nothing; without the key it is said that nobody looked."""
    before = read_bundle(bundle).digest
    assert main(["sign", str(bundle), "--key", str(keys[0])]) == 0
    assert main(["sign", str(bundle), "--key", str(keys[0])]) == 0
    by = capsys.readouterr().out.split()[-1]
    assert (bundle / SIGNATURE).stat().st_size == 64 and read_bundle(bundle).digest == before
    assert main(["verify", str(bundle), "--key", str(keys[1]), "--expect-digest", before.upper(), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["signer"], summary["signed"], summary["digest"]) == (by, True, before)
    assert main(["verify", str(bundle), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["signer"] is None
    assert main(["verify", str(bundle)]) == 0
    assert "was not checked" in capsys.readouterr().out


def test_what_the_maker_did_not_sign_is_refused(
    bundle: Path, keys: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Another key, one bit, another bundle's signature, none, and a bundle altered with every checksum made anew."""
    other = make_key(tmp_path / "other.pem")
    verify = ["verify", str(bundle), "--key"]
    assert main([*verify, str(keys[1])]) == 1
    assert "no signature" in capsys.readouterr().err
    assert main(["sign", str(bundle), "--key", str(keys[0])]) == 0
    assert main([*verify, str(other)]) == 1
    assert "not by the key" in capsys.readouterr().err
    assert main(["sign", str(bundle), "--key", str(other.with_suffix(".pem"))]) == 1
    assert "signature of another key" in capsys.readouterr().err
    good = (bundle / SIGNATURE).read_bytes()
    (bundle / SIGNATURE).write_bytes(bytes([good[0] ^ 1]) + good[1:])
    assert main([*verify, str(keys[1])]) == 1
    (bundle / SIGNATURE).write_bytes(good)
    second = make_bundle(tmp_path / "second", make_contract("go1"))
    (second / SIGNATURE).write_bytes(good)
    assert main(["verify", str(second), "--key", str(keys[1])]) == 1
    (bundle / "card.md").write_text("# Works everywhere\n")
    repair_sums(bundle)
    capsys.readouterr()
    assert main([*verify, str(keys[1])]) == 1
    assert "was altered" in capsys.readouterr().err


def test_nothing_is_read_before_the_signature_fits(bundle: Path, keys: tuple[Path, Path]) -> None:
    """A stranger's contract and network meet no parser where a key was named."""
    (bundle / "contract.json").write_text("{")
    repair_sums(bundle)
    with pytest.raises(StictionError, match="no signature"):
        read_bundle(bundle, lambda sums, signature: check_signature(sums, signature, keys[1]) and None)


def test_a_bundle_that_fails_its_check_is_not_signed(
    bundle: Path, keys: tuple[Path, Path], capsys: pytest.CaptureFixture
) -> None:
    """A signature says that somebody stands for it."""
    (bundle / "card.md").write_text("")
    assert main(["sign", str(bundle), "--key", str(keys[0])]) == 1
    assert "card.md" in capsys.readouterr().err and not (bundle / SIGNATURE).exists()


def test_keys_are_for_their_owner_and_never_overwritten(
    tmp_path: Path, keys: tuple[Path, Path], capsys: pytest.CaptureFixture
) -> None:
    """A lost key cannot be made again."""
    before = keys[0].read_bytes()
    assert keys[0].stat().st_mode & 0o777 == 0o600
    for name in ("maker.pem", "maker.pub", "maker"):
        assert main(["sign", "--new-key", str(tmp_path / name)]) == 1
        assert "choose another" in capsys.readouterr().err
    assert keys[0].read_bytes() == before


def test_what_is_no_such_key_is_refused(tmp_path: Path, bundle: Path, capsys: pytest.CaptureFixture) -> None:
    """RSA, text, nothing, a public key to sign with and a private one to check with."""
    rsa = generate_private_key(65537, 2048).private_bytes(
        form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption()
    )
    made = make_key(tmp_path / "maker.pem")
    contents = {"rsa.pem": rsa, "text.pem": b"hello", "empty.pem": b"", "long.pem": b"x" * 2**15}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    for name in (*contents, "nowhere.pem", made.name):
        assert main(["sign", str(bundle), "--key", str(tmp_path / name)]) == 1
        assert main(["verify", str(bundle), "--key", str(tmp_path / name)]) == 1
        shown = capsys.readouterr().err.splitlines()
        assert len(shown) == 2 and all("key" in line for line in shown)
    assert main(["verify", str(bundle), "--key", str(tmp_path / "maker.pem")]) == 1
    assert "its owner's secret" in capsys.readouterr().err
    assert not (bundle / SUMS).with_name(SIGNATURE).exists()


D = -121665 * pow(121666, -1, PRIME) % PRIME
"""Constant of the curve -x² + y² = 1 + D x² y² (RFC 8032, section 5.1)."""


def doubled(y: int) -> int:
    """Return y of 2 P for a point P of the curve: (y² + x²) / (2 - (y² - x²)), by the law of addition."""
    square, x_square = y * y % PRIME, (y * y - 1) * pow(D * y * y + 1, -1, PRIME) % PRIME
    return (square + x_square) * pow(2 - (square - x_square), -1, PRIME) % PRIME


def test_the_points_of_small_order_are_those_and_no_others() -> None:
    """8 P is the neutral element, y = 1, for each; 4, 2 or 1 times for the others; the base point is none of them."""
    times = {y: next(n for n, at in enumerate((y, doubled(y), doubled(doubled(y)), 1)) if at == 1) for y in SMALL_ORDER}
    # One point of order 1, one of order 2, two of order 4 with one y, four of order 8 with two: eight, the cofactor.
    assert sorted(times.values()) == [0, 1, 2, 3, 3]
    eight = {y: doubled(doubled(doubled(y))) for y in (*SMALL_ORDER, 4 * pow(5, -1, PRIME))}
    assert [eight.pop(4 * pow(5, -1, PRIME)) == 1, set(eight.values())] == [False, {1}]


@pytest.mark.parametrize("sign_bit", [0, 1])
@pytest.mark.parametrize("y", [*sorted(SMALL_ORDER), PRIME, PRIME + 1, PRIME + 9, 2**255 - 1])
def test_a_key_under_which_anybody_signs_is_refused(
    y: int, sign_bit: int, bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The neutral element as a key accepts one signature, (1, 0), of every message; so do other ways to write it."""
    raw = (y | sign_bit << 255).to_bytes(32, "little")
    key = Ed25519PublicKey.from_public_bytes(raw)
    weak = tmp_path / "weak.pub"
    weak.write_bytes(key.public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo))
    forged = (1).to_bytes(32, "little") + bytes(32)
    if y % PRIME == 1:
        key.verify(forged, b"whatever")
    (bundle / SIGNATURE).write_bytes(forged)
    for words in (["verify"], ["deploy", "--out", str(tmp_path / "run")], ["evaluate", "--out", str(tmp_path / "out")]):
        assert main([words[0], str(bundle), *words[1:], "--key", str(weak)]) == 1
        output = capsys.readouterr().err
        assert "weak key" in output and output.count("\n") == 1
    assert not (tmp_path / "run").exists() and not (tmp_path / "out").exists()


def test_what_walks_has_the_signature_that_was_asked_for(
    bundle: Path,
    keys: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without the maker's signature no robot is started and no folder made; with it `deploy` and `evaluate` go on."""

    def started(*_: object) -> None:
        raise StictionError("the robot was started")

    monkeypatch.setattr("stiction.virtual.serve.virtual_robot", started)
    monkeypatch.setattr("stiction.evaluation.summary.evaluate_all", started)
    other = make_key(tmp_path / "other.pem")
    verbs = ["deploy", str(bundle), "--armed"], ["evaluate", str(bundle)]
    asked = [[*words, "--out", str(tmp_path / words[0]), "--key"] for words in verbs]

    def refused(key: Path, message: str) -> None:
        for words in asked:
            assert main([*words, str(key)]) == 1
            printed = capsys.readouterr().err
            assert message in printed and printed.count("\n") == 1 and not (tmp_path / words[0]).exists()

    refused(keys[1], "no signature")
    assert main(["sign", str(bundle), "--key", str(keys[0])]) == 0
    capsys.readouterr()
    refused(other, "not by the key")
    refused(keys[0], "its owner's secret")
    for words in asked:
        assert main([*words, str(keys[1])]) == 1
        assert "the robot was started" in capsys.readouterr().err
    # A policy record, without its recorded steps, is walked by `evaluate`, and keeps its signature.
    (bundle / "golden.npz").unlink()
    for key, message in ((other, "not by the key"), (keys[1], "the robot was started")):
        assert main([*asked[1], str(key)]) == 1
        assert message in capsys.readouterr().err
