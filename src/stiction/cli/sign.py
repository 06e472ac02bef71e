"""`stiction sign BUNDLE --key KEY`: puts the maker's Ed25519 signature into a policy bundle."""

from __future__ import annotations

import getpass
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from stiction.core.errors import BundleError, ConfigurationError, FileError
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options, refuse
from stiction.files.bundle import SIGNATURE, shipped_bundles, shipped_folder


@dataclass(frozen=True)
class SignCfg:
    """Sign a policy bundle."""

    bundle: Annotated[Path | None, ARGUMENT] = None
    """Directory of the bundle, one of your own: none that came with the package. It is checked first, as `stiction
    verify` does."""
    key: Path | None = None
    """Your private key, a PEM file."""
    new_key: Path | None = None
    """Make a new private key here instead, such as maker.pem, and the public one beside it, maker.pub. Keep the first
    to yourself; publish the second where people trust you."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> None:
    """Sign one bundle, or make a key."""
    cfg = read_options(SignCfg, arguments, "stiction sign", DESCRIPTION)
    if cfg.new_key is not None:
        if cfg.bundle is not None or cfg.key is not None:
            raise ConfigurationError("--new-key makes a key and signs nothing; sign with it in a second command: --key")
        from stiction.files.signature import make_key

        public = make_key(cfg.new_key)
        _say(cfg, {"key": str(cfg.new_key), "public": str(public)}, f"{cfg.new_key}: private; {public}: public")
        return
    if cfg.bundle is None:
        refuse("stiction sign", "BUNDLE is missing: Directory of the bundle")
    _refuse_shipped(cfg.bundle)
    if cfg.key is None:
        refuse("stiction sign", "--key PATH is missing: Your private key, a PEM file")
    from stiction.core.files import write_bytes
    from stiction.deploy.check import check_bundle
    from stiction.files.signature import sign

    bundle = check_bundle(cfg.bundle).bundle
    signature, by = sign(bundle.sums, cfg.key, lambda: getpass.getpass(f"passphrase of {cfg.key}: "))
    if bundle.signature not in (None, signature):
        raise FileError(
            f"{cfg.bundle} has the signature of another key, or a damaged one; remove {SIGNATURE} to sign it"
        )
    write_bytes(cfg.bundle / SIGNATURE, signature)
    _say(cfg, {"bundle": str(cfg.bundle), "signature": by}, f"{cfg.bundle}: signed by the key {by}")


def _refuse_shipped(path: Path) -> None:
    """Refuse what is not there, and what came with the package: a signature is written into the bundle itself."""
    shipped = None if path.exists() else shipped_bundles().get(str(path))
    # Not `Path.resolve`, which raises where a link leads to itself.
    real, package = (Path(os.path.realpath(one)) for one in (shipped or path, shipped_folder()))
    if real.is_relative_to(package):
        raise ConfigurationError(
            f"{path} came with the package, into which nothing is written; copy it first, and sign the copy: "
            f"cp -r {real} my-{real.name}"
        )
    if not path.exists():
        raise BundleError(f"{path} does not exist; expected the directory of a policy bundle")


def _say(cfg: SignCfg, summary: dict[str, str], text: str) -> None:
    """Print what was done."""
    print(json.dumps(summary, indent=2) if cfg.json else text)


DESCRIPTION = (
    "Sign a policy bundle, so that `stiction verify BUNDLE --key maker.pub` finds its author, where checksums find "
    "accidents alone. The signature is of SHA256SUMS, which lists every file; it goes beside it, into SHA256SUMS.sig, "
    "and OpenSSL can check it too. Needs the extra sign (cryptography).\n\n"
    "Examples:\n  stiction sign --new-key maker.pem\n  stiction sign runs/mine/bundle --key maker.pem"
)
