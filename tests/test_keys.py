"""Key files: made for their owner alone, read strictly, and asked for wherever other machines can reach."""

import json
import os
import stat

import pytest
import zmq
from zmq.utils import z85

from drivers.endpoint import StreamError, endpoints
from drivers.keys import Keys, Peer, allow, forget, keys_for, load_keys, new_keys
from rigcast.__main__ import main

OTHER = "ab" * 32
posix = pytest.mark.skipif(os.name != "posix", reason="file modes are a POSIX matter")


def test_a_new_pair_is_kept_and_is_a_curve_pair(tmp_path):
    keys = new_keys(tmp_path / "keys")
    assert load_keys(tmp_path / "keys") == keys
    assert zmq.curve_public(z85.encode(keys.secret)) == z85.encode(keys.public)
    assert keys.secret.hex() not in repr(keys)
    assert new_keys(tmp_path / "others").secret != keys.secret


@posix
def test_key_files_are_for_their_owner_alone(tmp_path):
    folder = tmp_path / "keys"
    before = os.umask(0)  # the most careless one
    try:
        new_keys(folder)
        allow("pi", OTHER, ["follow"], folder)
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    for name in ("own.key", "allowed.toml"):
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o600
        for mode in (0o640, 0o604, 0o620):
            (folder / name).chmod(mode)
            with pytest.raises(StreamError, match=f"chmod 600 .*{name}"):
                load_keys(folder)
        (folder / name).chmod(0o600)
    assert load_keys(folder).peers == {"pi": Peer(OTHER, ("follow",))}


def test_a_pair_is_never_written_over(tmp_path):
    keys = new_keys(tmp_path)
    with pytest.raises(StreamError, match="is there already"):
        new_keys(tmp_path)
    assert load_keys(tmp_path) == keys


def test_no_key_says_how_to_make_one(tmp_path):
    with pytest.raises(StreamError, match=r"rigcast keys new.*--insecure"):
        load_keys(tmp_path)


def test_rights_are_kept_apart_and_our_own_key_has_all(tmp_path):
    keys = new_keys(tmp_path)
    allow("pi", OTHER, ["control", "follow", "follow"], tmp_path)
    allow("screen", "cd" * 32, ["follow"], tmp_path)
    after = allow("desk", "ef" * 32, ["lead"], tmp_path)
    assert load_keys(tmp_path) == after
    assert after.peers["pi"].may == ("follow", "control")
    pi, screen, desk = (bytes.fromhex(k * 32) for k in ("ab", "cd", "ef"))
    assert after.allowed("follow") == {keys.public, pi, screen}
    assert after.allowed("control") == {keys.public, pi}
    assert (after.leader(), after.leader("desk"), after.leader("own")) == (desk, desk, keys.public)
    assert forget("screen", tmp_path).allowed("follow") == {keys.public, pi}
    assert load_keys(tmp_path).allowed("follow") == {keys.public, pi}


def test_which_leader_must_be_clear():
    one, two = Peer("ab" * 32, ("lead",)), Peer("cd" * 32, ("lead",))
    with pytest.raises(StreamError, match="no key may lead"):
        Keys(bytes(32), {"pi": Peer(OTHER, ("follow",))}).leader()
    with pytest.raises(StreamError, match="desk, loft may lead: say which with --leader"):
        Keys(bytes(32), {"desk": one, "loft": two}).leader()
    with pytest.raises(StreamError, match=r"leader 'pi'.*own, desk, loft"):
        Keys(bytes(32), {"desk": one, "loft": two, "pi": Peer("ef" * 32, ("follow",))}).leader("pi")


@pytest.mark.parametrize(
    ("name", "key", "may", "words"),
    [
        ("a.b", OTHER, ["follow"], "name 'a.b'"),
        ("", OTHER, ["follow"], "name ''"),
        ("own", OTHER, ["follow"], "name 'own'"),
        ("pi", OTHER[:-1], ["follow"], "64 hex digits"),
        ("pi", OTHER.upper(), ["follow"], "64 hex digits"),
        ("pi", OTHER, [], "may nothing"),
        ("pi", OTHER, ["rule"], "may rule: choose out of follow, control, lead"),
        ("pi", "cd" * 32, ["follow"], "is that of 'screen' already"),
    ],
)
def test_a_wrong_permission_is_one_line_and_changes_nothing(tmp_path, name, key, may, words):
    new_keys(tmp_path)
    before = allow("screen", "cd" * 32, ["follow"], tmp_path)
    with pytest.raises(StreamError, match=words) as caught:
        allow(name, key, may, tmp_path)
    assert "\n" not in str(caught.value)
    assert load_keys(tmp_path) == before


@pytest.mark.parametrize(
    "text",
    [
        "[pi]",
        "pi = 3",
        f"[pi]\nkey = '{OTHER}'\nmay = ['rule']",
        f"[pi]\nkey = '{OTHER}'\nmay = 'follow'",
        f"[pi]\nkey = '{OTHER[:-1]}'\nmay = []",
        f"[pi]\nkey = '{OTHER}'\nmay = []\nmood = 1",
        f"[a]\nkey = '{OTHER}'\nmay = []\n[b]\nkey = '{OTHER}'\nmay = []",
        "[pi\n",
    ],
)
def test_a_list_that_is_not_understood_names_the_file(tmp_path, text):
    new_keys(tmp_path)
    (tmp_path / "allowed.toml").write_text(text)
    (tmp_path / "allowed.toml").chmod(0o600)
    with pytest.raises(StreamError, match=r"allowed\.toml: "):
        load_keys(tmp_path)


def test_a_secret_that_is_no_key_is_refused_without_being_told(tmp_path):
    new_keys(tmp_path)
    (tmp_path / "own.key").write_text("1234")
    with pytest.raises(StreamError, match=r"own\.key: not a key of 64 hex digits$"):
        load_keys(tmp_path)


LOCAL = ["tcp://127.0.0.1:5555", "tcp://127.9.9.9:5555", "tcp://localhost:5555", "tcp://[::1]:5555", "ipc:///tmp/x"]
OPEN = ["tcp://*:5555", "tcp://0.0.0.0:5555", "tcp://192.168.1.5:5555", "tcp://127.0.0.1.example.org:5555"]
OPEN += ["tcp://localhost.example.org:5555", "tcp://eth0:5555", "tcp://[fe80::1]:5555", "tcp://1127.0.0.1:5555"]


@pytest.mark.parametrize("address", LOCAL)
def test_this_machine_alone_needs_no_keys(address, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert keys_for(endpoints(address)) is None
    with pytest.raises(StreamError, match="keys new"):
        keys_for(endpoints(address), leader="desk")


@pytest.mark.parametrize("address", OPEN)
def test_other_machines_need_keys_unless_insecure_is_said(address, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with pytest.raises(StreamError, match="keys new"):
        keys_for(endpoints(address))
    assert keys_for(endpoints(address), insecure=True) is None
    with pytest.raises(StreamError, match="--insecure and --leader desk"):
        keys_for(endpoints(address), insecure=True, leader="desk")
    assert keys_for(endpoints(address)) if new_keys() else None


# --- the verbs


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


def test_keys_are_made_allowed_listed_and_forgotten(home, capsys):
    assert main(["keys", "new"]) == 0
    public = capsys.readouterr().out.strip()
    assert public == load_keys(home / "rigcast" / "keys").public.hex()
    assert main(["keys", "allow", "pi", OTHER, "--may", "follow", "--may", "control"]) == 0
    assert main(["keys", "list", "--json"]) == 0
    said = capsys.readouterr().out.partition("\n")
    assert said[0] == "pi may follow control"
    own, pi = json.loads(said[2])
    assert (own["name"], own["key"]) == ("own", public)
    assert pi == {"name": "pi", "may": ["follow", "control"], "key": OTHER}
    assert main(["keys", "forget", "pi"]) == 0
    assert load_keys(home / "rigcast" / "keys").peers == {}


@pytest.mark.parametrize(
    "args",
    [
        ["keys", "list"],
        ["view", "tcp://192.0.2.1:5555"],
        ["view", "--leader", "desk"],
        ["drive", "--port", "sim", "--endpoint", "tcp://192.0.2.1:5555"],
        ["play", "none.bvh", "--publish", "tcp://*:47005"],
    ],
)
def test_without_a_key_other_machines_are_one_line_and_exit_2(home, args, capsys, monkeypatch):
    monkeypatch.setattr("rigcast.play.read", lambda *_: None)
    assert main(args) == 2
    said = capsys.readouterr().err
    assert said.startswith("rigcast: no key in ")
    assert "rigcast keys new" in said
    assert said.count("\n") == 1
