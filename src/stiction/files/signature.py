"""Ed25519 signatures of bundles, which prove their maker. Keys are PEM files as OpenSSL writes them.

The signed message is SHA256SUMS, byte for byte, which lists every other file; the signature is 64 bytes. OpenSSL checks
it too: `openssl pkeyutl -verify -pubin -inkey maker.pub -rawin -in SHA256SUMS -sigfile SHA256SUMS.sig`.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from stiction.core.errors import FileError
from stiction.core.files import read_bounded, unwritten

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

Key = TypeVar("Key")

PRIME = 2**255 - 19
"""Modulus of Ed25519's field."""

EIGHTH = 2707385501144840649318225287225658788936804267575313519463743609750303402022
"""y of points of order 8: the root of d y⁴ + 2 y² = 1, where d is the curve's constant."""

SMALL_ORDER = frozenset((0, 1, PRIME - 1, EIGHTH, PRIME - EIGHTH))
"""y of the eight points whose order divides 8 (RFC 8032, section 5.1). As public keys they prove nothing: anybody can
make a signature that they accept."""

MOST_BYTES = 2**14
"""Maximum size of a key file [B]."""


def make_key(path: Path) -> Path:
    """Write a new private key to `path`, readable by its owner only, and its public key next to it; return the latter's
    path.

    Raises `FileError` where one of the two exists, or cannot be written.
    """
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    public, key = path.with_suffix(".pub"), Ed25519PrivateKey.generate()
    private_text = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    public_text = key.public_key().public_bytes(form.Encoding.PEM, form.PublicFormat.SubjectPublicKeyInfo)
    if public == path or public.exists():
        raise FileError(f"{public} exists already, or is the private key; choose another name, such as maker.pem")
    for file, text, mode in ((path, private_text, 0o600), (public, public_text, 0o644)):
        try:
            # The mode from the beginning, so that at no moment others can read the key; and nothing that is there is
            # overwritten.
            with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as opened:
                opened.write(text)
        except FileExistsError as error:
            raise FileError(f"{file} cannot be written: {error.strerror}; choose another name") from error
        except OSError as error:
            # Half a key is none, and neither is one without its other half.
            for half in {path, file}:
                with suppress(OSError):
                    half.unlink()
            raise unwritten(file, error) from error
    return public


def sign(message: bytes, path: Path, passphrase: Callable[[], str]) -> tuple[bytes, str]:
    """Return the signature of a message, 64 bytes, by the private key in a PEM file, and that key's fingerprint.

    passphrase: called for an encrypted key. Raises `FileError` for a file without such a key.
    """
    key = _private_key(path, passphrase)
    return key.sign(message), fingerprint(key.public_key())


def check_signature(message: bytes, signature: bytes | None, path: Path) -> str:
    """Return the fingerprint of the public key in a PEM file, whose signature of a message is valid.

    Raises `FileError`: a file without such a key, or a missing signature, or one by another key, or of another message.
    """
    from cryptography.exceptions import InvalidSignature

    key = _public_key(path)
    if signature is None:
        raise FileError(f"the bundle has no signature, and {path} was named to check it; get a signed one, or see who "
                        "published its digest: --expect-digest")  # fmt: skip
    try:
        key.verify(signature, message)
    except InvalidSignature as error:
        raise FileError(
            f"the bundle's signature is not by the key {path} ({fingerprint(key)}), or the bundle was altered; do not "
            "use it"
        ) from error
    return fingerprint(key)


def fingerprint(key: Ed25519PublicKey) -> str:
    """Return the fingerprint of a public key: the first half of its SHA-256, in hexadecimal."""
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    return hashlib.sha256(key.public_bytes(Encoding.Raw, PublicFormat.Raw)).hexdigest()[:32]


def _private_key(path: Path, passphrase: Callable[[], str]) -> Ed25519PrivateKey:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    content = read_bounded(path, f"a key, PEM: {NEW_KEY}", FileError, MOST_BYTES)
    # Before it is parsed, here and below: the readers of keys would only say that it is none.
    if b"PUBLIC KEY" in content and b"PRIVATE KEY" not in content:
        raise FileError(
            f"{path} is a public key, which checks signatures and makes none; name the private one, "
            f"{path.with_suffix('.pem')}"
        )

    def load() -> object:
        return load_pem_private_key(content, passphrase().encode() if b"ENCRYPTED" in content else None)

    return _ed25519(path, load, Ed25519PrivateKey, "private")


def _public_key(path: Path) -> Ed25519PublicKey:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    content = read_bounded(path, f"a key, PEM: {NEW_KEY}", FileError, MOST_BYTES)
    if b"PRIVATE KEY" in content:
        raise FileError(f"{path} is a private key, its owner's secret; name the public one, {path.with_suffix('.pub')}")
    key = _ed25519(path, lambda: load_pem_public_key(content), Ed25519PublicKey, "public")
    y = int.from_bytes(key.public_bytes_raw(), "little") & (2**255 - 1)
    if y >= PRIME or y in SMALL_ORDER:
        raise FileError(
            f"{path} holds a weak key, under which a signature of one bundle fits others; get the maker's own key, or "
            f"make one: {NEW_KEY}"
        )
    return key


def _ed25519(path: Path, load: Callable[[], object], kind: type[Key], which: str) -> Key:
    """Return a loaded key of a kind; raise `FileError` for another one."""
    try:
        key = load()
    except Exception as error:  # ValueError, TypeError, UnsupportedAlgorithm, by what is wrong
        cause = " ".join(str(error).split()).partition(". ")[0][:120] or type(error).__name__
        raise FileError(f"{path}: {cause}; expected a {which} Ed25519 key, PEM: {NEW_KEY}") from error
    if not isinstance(key, kind):
        raise FileError(f"{path} holds another kind of key; expected a {which} Ed25519 key, PEM: {NEW_KEY}")
    return key


NEW_KEY = "stiction sign --new-key maker.pem makes maker.pem and maker.pub"
"""Command that makes a key, for messages."""
