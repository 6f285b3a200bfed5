"""Processes that die, freeze and come back, and links that damage: what the rig does, by its own account.

The rig writes down each cycle. Whatever the machine does to the processes, no cycle may follow without a fresh frame,
follow a frame that is old or was there before, or move further than a cycle's worth of the speed limit.
"""

import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bad_link import BadLink
from chaos_rig import HOLD_S
from small_rig import free_address, small_rig

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="freezes processes as POSIX does")

RIG = small_rig()
TESTS = Path(__file__).parent
NS = 1_000_000_000
CYCLE_S = 1 / 50
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join((str(TESTS.parent), str(TESTS)))}
FAR = 60.0  # seconds: never, in these tests
PUBLISHER = """
import sys
from small_rig import REPORT, small_rig, swing
from drivers.publisher import publish
publish(swing(small_rig(), 600), small_rig(), REPORT, sys.argv[1])
"""


@contextmanager
def process(*command, inside=()):
    with subprocess.Popen([*inside, sys.executable, *command], cwd=TESTS.parent, env=ENVIRONMENT) as child:
        try:
            yield child
        finally:
            child.send_signal(signal.SIGCONT)
            child.kill()


def publishing(address, inside=()):
    return process("-c", PUBLISHER, address, inside=inside)


@contextmanager
def network():
    """A network of its own with nothing in it but a loopback link: what to put before a command to run it there."""
    try:
        subprocess.run(["unshare", "-rn", "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no right to make a network namespace here")
    with subprocess.Popen(["unshare", "-rn", "sleep", "600"]) as keeper:
        try:
            ours = os.readlink("/proc/self/ns/net")
            end = time.monotonic() + 20
            while os.readlink(f"/proc/{keeper.pid}/ns/net") == ours:
                assert time.monotonic() < end
                time.sleep(0.01)
            inside = ["nsenter", "-t", str(keeper.pid), "-U", "-n", "--preserve-credentials"]
            subprocess.run([*inside, "ip", "link", "set", "lo", "up"], check=True)
            yield inside
        finally:
            keeper.kill()


class Account:
    """What a rig has told."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def lines(self) -> list[dict]:
        text = self.path.read_text() if self.path.exists() else ""
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    @property
    def cycles(self) -> list[dict]:
        return [line for line in self.lines if "now" in line]

    def wait_for(self, condition, seconds=60.0):
        """Wait until `condition` holds for the cycles after what is told by now."""
        before, end = len(self.cycles), time.monotonic() + seconds
        while not condition(self.cycles[before:]):
            assert time.monotonic() < end, self.lines[-3:]
            time.sleep(0.05)

    def wait_for_mode(self, mode, cycles=1):
        self.wait_for(lambda told: sum(line["mode"] == mode for line in told) >= cycles)


@contextmanager
def rig(address, path, safe_s=FAR, inside=()):
    with process("tests/chaos_rig.py", address, str(path), str(safe_s), inside=inside) as child:
        yield child, Account(path)


def check(account: Account) -> None:
    """What must hold whatever happens."""
    least, newest, fresh = {}, {}, None
    for line in account.cycles:
        if line["frame"] is not None:
            stream, seq, captured, angle = line["frame"]
            age = (line["now"] - captured) / NS  # one machine, one clock: the true age
            least[stream] = min(least.get(stream, age), age)
            assert age - least[stream] <= HOLD_S + 0.01, "an old frame was followed"
            assert seq > newest.get(stream, -1), "a frame was followed twice or out of order"
            assert angle == pytest.approx(0.2 + 0.2 * (1 - math.cos(2 * math.pi * seq / 50)), abs=1e-5), "a wrong frame"
            newest[stream], fresh = seq, line["now"]
        if line["mode"] == "following":
            assert line["now"] - fresh <= HOLD_S * NS, "it followed without a fresh frame"
    commands = np.array([line["command"] for line in account.lines if "command" in line])
    assert np.abs(np.diff(commands, axis=0)).max() <= RIG.joints[0].velocity * CYCLE_S + 1e-9, "it jumped"


def test_a_publisher_that_freezes_is_killed_and_starts_again(tmp_path):
    address = free_address()
    with rig(address, tmp_path / "rig") as (_, account):
        with publishing(address) as publisher:
            account.wait_for_mode("following", cycles=10)
            publisher.send_signal(signal.SIGSTOP)
            account.wait_for_mode("hold", cycles=20)
            publisher.send_signal(signal.SIGCONT)
            account.wait_for_mode("following", cycles=10)
            publisher.kill()
            account.wait_for_mode("hold")
        with publishing(address):
            account.wait_for_mode("following", cycles=10)
    check(account)
    assert len({line["frame"][0] for line in account.cycles if line["frame"]}) == 2


def test_a_rig_that_was_frozen_for_a_moment_goes_on(tmp_path):
    address = free_address()
    with rig(address, tmp_path / "rig") as (child, account), publishing(address):
        account.wait_for_mode("following", cycles=10)
        child.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        child.send_signal(signal.SIGCONT)
        account.wait_for_mode("following", cycles=10)
    check(account)
    now = [line["now"] for line in account.cycles]
    assert np.diff(now).max() > 0.5 * NS  # it was


def test_a_rig_that_was_frozen_too_long_does_not_go_on(tmp_path):
    address = free_address()
    with rig(address, tmp_path / "rig", safe_s=0.8) as (child, account), publishing(address):
        account.wait_for_mode("following", cycles=10)
        child.send_signal(signal.SIGSTOP)
        time.sleep(1.2)
        child.send_signal(signal.SIGCONT)
        assert child.wait(60) == 0
    check(account)
    now = [line["now"] for line in account.cycles]
    woke = int(np.argmax(np.diff(now) > NS)) + 1
    assert {line["mode"] for line in account.cycles[woke:]} == {"safe"}
    last = account.lines[-1]
    assert (last["ended"], last["torque"]) == ("safe", False)


def test_over_a_bad_link_it_follows_what_is_good_and_holds_where_nothing_is(tmp_path):
    source, address = free_address(), free_address()
    with BadLink(source, address) as link, rig(address, tmp_path / "rig") as (_, account), publishing(source):
        account.wait_for_mode("following", cycles=5)
        link.drop, link.double, link.flip, link.spread_s = 0.2, 0.3, 0.3, 0.1
        account.wait_for(lambda told: told and min(told[-1]["refused"].get(k, 0) for k in ("damaged", "order")) > 8)
        link.drop = link.double = link.flip = link.spread_s = 0.0
        account.wait_for_mode("following", cycles=10)
        link.delay_s = 0.2  # late, but not too late
        account.wait_for_mode("following", cycles=30)
        link.delay_s = 0.8
        account.wait_for(lambda told: told and told[-1]["mode"] == "hold" and told[-1]["refused"].get("stale", 0) > 8)
        link.delay_s = 0.0
        account.wait_for_mode("following", cycles=10)
        link.drop = 1.0  # the cable is cut
        account.wait_for_mode("hold")
        link.drop = 0.0
        account.wait_for_mode("following", cycles=10)
    check(account)


def test_a_publisher_that_freezes_for_five_seconds_finds_its_rig_relaxed(tmp_path):
    address = free_address()
    with rig(address, tmp_path / "rig", safe_s=2.0) as (child, account), publishing(address) as publisher:
        account.wait_for_mode("following", cycles=10)
        publisher.send_signal(signal.SIGSTOP)
        time.sleep(5.0)
        publisher.send_signal(signal.SIGCONT)
        assert child.wait(60) == 0
    check(account)
    last = account.lines[-1]
    assert (last["ended"], last["torque"]) == ("safe", False)
    assert [line["mode"] for line in account.cycles].count("hold") * CYCLE_S <= 2.0


def test_a_link_that_is_cut_holds_the_rig_and_comes_back(tmp_path):
    address = free_address()
    with (
        network() as inside,
        rig(address, tmp_path / "rig", inside=inside) as (_, account),
        publishing(address, inside),
    ):
        account.wait_for_mode("following", cycles=10)
        subprocess.run([*inside, "ip", "link", "set", "lo", "down"], check=True)
        account.wait_for_mode("hold", cycles=20)
        subprocess.run([*inside, "ip", "link", "set", "lo", "up"], check=True)
        account.wait_for_mode("following", cycles=10)
    check(account)
