"""Whom a stream is for: this machine's CURVE key pair, and the public keys of others with what each of them may do.

Two files in `<config>/rigcast/keys/`, `<config>` being `$XDG_CONFIG_HOME` or `~/.config`, both for their owner alone:
`own.key`, the secret key as 64 hex digits, and `allowed.toml`, a table for each other machine:

    [desk]
    key = "…"                     # its public key, 64 hex digits
    may = ["follow", "control"]   # out of follow, control, lead, say
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
import zmq
from zmq.utils import z85

from drivers.endpoint import Endpoints, StreamError

Right = Literal["follow", "control", "lead", "say"]
RIGHTS: tuple[Right, ...] = get_args(Right)
OWN = "own"
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
_KEY = re.compile(r"[0-9a-f]{64}")


class Peer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Another machine's public `key` (64 hex digits) and what it `may` do.

    `follow`: receive our frames, hello and stop. `control`: send us a rig's state. `lead`: send the frames that our
    rigs follow. `say`: tell our service what the rig shall do. Each of them may stop us.
    """

    key: Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{64}\Z")]
    may: tuple[Right, ...]


@dataclass(frozen=True)
class Keys:
    """This machine's `secret` key (32 bytes) and the `peers` by name. Our own key may do everything."""

    secret: bytes
    peers: dict[str, Peer]

    def __repr__(self) -> str:
        return f"Keys(of {self.public.hex()}, {len(self.peers)} peers)"

    @property
    def public(self) -> bytes:
        """The public key (32 bytes) that belongs to `secret`."""
        return z85.decode(zmq.curve_public(z85.encode(self.secret)))

    def allowed(self, right: Right) -> frozenset[bytes]:
        """The public keys that have `right`."""
        return frozenset((self.public, *(bytes.fromhex(p.key) for p in self.peers.values() if right in p.may)))

    def everybody(self) -> dict[bytes, str]:
        """The name that each public key has here, whatever it may do."""
        return {self.public: OWN, **{bytes.fromhex(p.key): name for name, p in self.peers.items()}}

    def leader(self, name: str = "") -> bytes:
        """The public key of the machine `name`, or of the only one that may lead; raises StreamError otherwise."""
        if name == OWN:
            return self.public
        leaders = {n: p for n, p in self.peers.items() if "lead" in p.may}
        if name and name not in leaders:
            raise StreamError(f"leader {name!r}: no such key may lead; those that may: {', '.join((OWN, *leaders))}")
        if not name and len(leaders) != 1:
            many = f"{', '.join(leaders)} may lead: say which with --leader" if leaders else "no key may lead"
            raise StreamError(f"{many}; `rigcast keys allow NAME KEY --may lead` allows one")
        return bytes.fromhex(leaders[name or next(iter(leaders))].key)


def keys_folder() -> Path:
    """Where this user keeps the keys."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "rigcast" / "keys"


def new_keys(folder: Path | None = None) -> Keys:
    """Make this machine's key pair. Raises StreamError where there is one: others have allowed it by now."""
    folder = folder or keys_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    secret = z85.decode(zmq.curve_keypair()[1])
    try:
        _write_private(folder / "own.key", secret.hex() + "\n")
    except FileExistsError:
        raise StreamError(f"{folder / 'own.key'} is there already; remove it first if nobody is to know it") from None
    return load_keys(folder)


def load_keys(folder: Path | None = None) -> Keys:
    """The keys in `folder`. Raises StreamError naming what is missing, readable by others or not understood."""
    folder = folder or keys_folder()
    try:
        secret = _read_private(folder / "own.key").strip()
    except FileNotFoundError:
        raise StreamError(f"no key in {folder}: `rigcast keys new` makes one, or say --insecure") from None
    if not _KEY.fullmatch(secret):
        raise StreamError(f"{folder / 'own.key'}: not a key of 64 hex digits")
    return Keys(bytes.fromhex(secret), _peers(folder / "allowed.toml"))


def allow(name: str, key: str, may: Iterable[Right], folder: Path | None = None) -> Keys:
    """Let the machine with the public `key` do what `may` says, under `name`; replaces what `name` was before.

    Raises StreamError for a name, key or right that is none, for our own key and for one that has another name.
    """
    folder = folder or keys_folder()
    keys, rights = load_keys(folder), tuple(r for r in RIGHTS if r in set(may))
    if not _NAME.fullmatch(name) or name == OWN:
        raise StreamError(f"name {name!r}: letters, digits, - and _, and not {OWN!r}")
    if not _KEY.fullmatch(key):
        raise StreamError(f"key {key!r}: a public key is 64 hex digits, as `rigcast keys list` shows there")
    if not rights or set(may) - set(RIGHTS):
        raise StreamError(f"may {', '.join(may) or 'nothing'}: choose out of {', '.join(RIGHTS)}")
    holders = {OWN: keys.public.hex(), **{n: p.key for n, p in keys.peers.items() if n != name}}
    if key in holders.values():
        raise StreamError(f"the key is that of {next(n for n, k in holders.items() if k == key)!r} already")
    return _save(folder, keys, {**keys.peers, name: Peer(key, rights)})


def forget(name: str, folder: Path | None = None) -> Keys:
    """Allow the machine `name` nothing any more; a stream that runs is told when it starts again.

    Raises StreamError where there is no such name.
    """
    folder = folder or keys_folder()
    keys = load_keys(folder)
    if name not in keys.peers:
        raise StreamError(f"no key {name!r}; there are {', '.join(keys.peers) or 'none'}")
    return _save(folder, keys, {n: p for n, p in keys.peers.items() if n != name})


def keys_for(address: Endpoints, *, insecure: bool = False, leader: str = "") -> Keys | None:
    """The keys that an endpoint asks for; None where it is this machine's alone, or where `insecure` is said.

    Naming a `leader` asks for keys everywhere. Raises StreamError where they cannot be read or both are said.
    """
    if insecure and leader:
        raise StreamError(f"--insecure and --leader {leader}: a leader is known by its key")
    return None if insecure or (address.local and not leader) else load_keys()


def require_guarded(at: Endpoints, keys: Keys | None, insecure: bool) -> None:
    """Raise StreamError where other machines reach an endpoint that has no keys, unless `insecure` is said."""
    if keys is None and not insecure and not at.local:
        raise StreamError(f"{at.frames} can be reached from other machines: give keys, or say --insecure")


def _peers(path: Path) -> dict[str, Peer]:
    try:
        given = tomllib.loads(_read_private(path))
        peers = msgspec.convert(given, dict[str, Peer])
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        raise StreamError(f"{path}: {error}") from None
    if len({p.key for p in peers.values()}) < len(peers):
        raise StreamError(f"{path}: two names have the same key")
    return peers


def _save(folder: Path, keys: Keys, peers: dict[str, Peer]) -> Keys:
    tables = (f'[{n}]\nkey = "{p.key}"\nmay = {json.dumps(p.may)}\n' for n, p in peers.items())
    new = folder / "allowed.toml.new"
    new.unlink(missing_ok=True)
    _write_private(new, "\n".join(tables))
    new.replace(folder / "allowed.toml")
    return Keys(keys.secret, peers)


def _write_private(path: Path, text: str) -> None:
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
        file.write(text)


def _read_private(path: Path) -> str:
    with open(path, encoding="utf-8") as file:
        if os.name == "posix" and os.fstat(file.fileno()).st_mode & 0o077:
            raise StreamError(f"{path} is open to other users: chmod 600 {path}")
        return file.read()
