"""Strangers at the sockets: they receive nothing, command nothing, and nothing that they send does harm."""

import random
import socket
import struct
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
import zmq
from small_rig import REPORT, free_address, small_rig, swing
from tap import Tap
from zmq.utils import z85

from drivers.endpoint import StreamError, endpoints
from drivers.frame import FrameError, encode
from drivers.keys import Keys, Peer
from drivers.messages import RigState, Stop, pack, unpack
from drivers.publisher import MOST_STATES_PER_S, Publisher, frames_of, hello_for
from drivers.rate import Rate
from drivers.receiver import Receiver
from drivers.relay import relay
from drivers.sockets import Curve, open_socket

RIG = small_rig()
MOVE = swing(RIG)
FRAME = next(frames_of(MOVE, RIG, REPORT, 1, 0))
STATE = RigState("small", RIG.hash, "following", "", 3, 4, (0.1, 0.2, 0.3))
NS = 1_000_000_000


def pair() -> Keys:
    return Keys(z85.decode(zmq.curve_keypair()[1]), {})


def knowing(keys: Keys, **others: tuple[Keys, str]) -> Keys:
    """`keys` that allow others by name: (their keys, "rights with spaces between")."""
    peers = {name: Peer(other.public.hex(), tuple(may.split())) for name, (other, may) in others.items()}
    return replace(keys, peers=peers)


DESK, PI, STRANGER = pair(), pair(), pair()
DESK = knowing(DESK, pi=(PI, "follow control"))
PI = knowing(PI, desk=(DESK, "lead"))
STRANGER = knowing(STRANGER, desk=(DESK, "lead"))


class Sender:
    """A publisher that goes on sending, a frame with each call, on a clock of its own."""

    def __init__(self, publisher: Publisher) -> None:
        self.publisher, self.seq = publisher, 0

    def __call__(self) -> None:
        self.seq += 1
        now = time.monotonic_ns()
        self.publisher.send(replace(FRAME, seq=self.seq, capture_ns=now, due_ns=now))
        self.publisher._next_hello_ns = 0  # a hello with each
        self.publisher.tick()
        time.sleep(0.005)


@contextmanager
def sending(keys: Keys | None, address: str):
    with Publisher(hello_for(MOVE, RIG, REPORT, 1), address, keys=keys) as publisher:
        yield Sender(publisher)


def until(condition, seconds=60.0):
    """Wait for `condition()`; the first true value of it."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "nothing came"
    return found


@contextmanager
def sockets(*wanted):
    """Plain sockets (kind, address, Curve or None) that connect, of one context."""
    context = zmq.Context()
    try:
        yield [open_socket(context, k, a, bind=False, max_bytes=1 << 20, queue=2000, curve=c) for k, a, c in wanted]
    finally:
        context.destroy(0)


def follows(send: Sender, receiver: Receiver) -> bool:
    send()
    receiver.poll(time.monotonic_ns())
    return receiver.gate.accepted > 3 and receiver.hello is not None


# --- who is let in


def test_friends_hear_and_are_heard():
    address = free_address()
    with sending(DESK, address) as send, Receiver(address, rig_hash=RIG.hash, keys=PI) as receiver:
        until(lambda: follows(send, receiver))
        assert until(lambda: send() or receiver.send_state(STATE) or send.publisher.states())[0] == STATE
        send.publisher.stop("enough")
        until(lambda: receiver.poll(time.monotonic_ns()) or receiver.watchdog.mode == "stopped")
        assert (sum(send.publisher.refused.values()), receiver.trouble) == (0, "")


def test_a_stranger_receives_no_byte_of_motion_and_commands_nothing():
    address = free_address()
    at = endpoints(address)
    known = Curve(STRANGER.secret, server=DESK.public)  # has learnt whom to ask, but was not allowed
    guess = Curve(PI.secret, server=STRANGER.public)  # a stolen key, but not whom to ask
    ways = (known, guess, None)
    with sending(DESK, address) as send, Tap(int(at.frames.rpartition(":")[2])) as tap:
        tapped = f"tcp://127.0.0.1:{tap.port}"
        subs = [(zmq.SUB, a, way) for a in (tapped, at.hello, at.stop) for way in ways]
        with (
            sockets(*subs, *((zmq.PUB, at.state, way) for way in ways)) as strangers,
            Receiver(address, rig_hash=RIG.hash, keys=PI) as friend,
        ):
            ears, mouths = strangers[: len(subs)], strangers[len(subs) :]

            def all_were_refused():
                for mouth in mouths:
                    mouth.send(pack(STATE), zmq.NOBLOCK)
                assert send.publisher.states() == []
                refused = send.publisher.refused
                return follows(send, friend) and refused["stranger"] >= 4 and refused["handshake"] >= 8

            until(all_were_refused)
            send.publisher.stop("to those who may hear it")
            until(lambda: friend.poll(time.monotonic_ns()) or friend.watchdog.mode == "stopped")
            assert not any(ear.poll(20) for ear in ears)
        # What the strangers were told is a greeting and at most a WELCOME and an ERROR: shorter than one frame more.
        assert len(tap.told) >= 3
        assert max(sum(map(len, chunks)) for chunks in tap.told) < 64 + 170 + 40 < 64 + 170 + len(encode(FRAME))


def test_frames_and_control_are_allowed_apart():
    watcher, hand = pair(), pair()
    desk = knowing(DESK, screen=(watcher, "follow"), hand=(hand, "control"))
    watcher, hand = (knowing(k, desk=(DESK, "lead")) for k in (watcher, hand))
    address = free_address()
    with (
        sending(desk, address) as send,
        Receiver(address, rig_hash=RIG.hash, keys=watcher) as screen,
        Receiver(address, rig_hash=RIG.hash, keys=hand) as deaf,
    ):
        by_hand, by_screen = (msgspec.structs.replace(STATE, rig=name) for name in ("hand", "screen"))
        heard = []

        def both_did_what_they_may():
            deaf.poll(time.monotonic_ns())
            deaf.send_state(by_hand)
            screen.send_state(by_screen)
            heard.extend(send.publisher.states())
            return follows(send, screen) and len(heard) > 3 and send.publisher.refused["stranger"] >= 4

        until(both_did_what_they_may)
        assert set(heard) == {by_hand}
        assert (deaf.gate.accepted, deaf.hello) == (0, None)
        for refused in (deaf, screen):  # the screen may not send; its frames come
            until(lambda r=refused: r.poll(time.monotonic_ns()) or "does not allow this machine's key" in r.trouble)


@pytest.mark.parametrize(("impostor", "words"), [(STRANGER, "not the leader's"), (None, "one end uses keys")])
def test_an_impostor_commands_nothing(impostor, words):
    address = free_address()
    with sending(impostor, address) as send, Receiver(address, rig_hash=RIG.hash, keys=PI) as receiver:
        send.publisher.stop("I say so")
        until(lambda: follows(send, receiver) or words in receiver.trouble)
        for _ in range(20):
            send()
            assert receiver.poll(time.monotonic_ns()) is None
        assert (receiver.watchdog.mode, receiver.hello, receiver.gate.refused) == ("waiting", None, {})


def test_a_key_that_is_allowed_later_gets_in_without_a_new_start():
    address = free_address()
    with Receiver(address, rig_hash=RIG.hash, keys=STRANGER) as receiver:
        with sending(DESK, address) as send:
            until(lambda: follows(send, receiver) or "does not allow" in receiver.trouble)
        with sending(knowing(DESK, pi=(STRANGER, "follow")), address) as send:
            until(lambda: follows(send, receiver) and receiver.trouble == "")


def test_other_machines_are_not_served_without_keys_unless_insecure_is_said():
    address, hello = free_address().replace("127.0.0.1", "*"), hello_for(MOVE, RIG, REPORT, 1)
    with pytest.raises(StreamError, match="--insecure"):
        Publisher(hello, address)
    with pytest.raises(StreamError, match="--insecure"):
        Receiver("tcp://192.0.2.1:5555", rig_hash=RIG.hash)
    Publisher(hello, address, insecure=True).close()
    Publisher(hello, address, keys=DESK).close()


# --- what was once said cannot be said again


def test_a_recording_of_a_command_does_nothing():
    address = free_address()
    port = int(endpoints(address).state.rpartition(":")[2])
    with sending(DESK, address) as send, Tap(port) as tap:
        curve = Curve(PI.secret, server=DESK.public)
        with sockets((zmq.PUB, f"tcp://127.0.0.1:{tap.port}", curve)) as [mouth]:
            until(lambda: mouth.send(pack(STATE)) or time.sleep(0.02) or send.publisher.states())
            time.sleep(0.1)
            while send.publisher.states():
                pass
            before = len(tap.heard[0])
            mouth.send(pack(STATE))
            assert until(send.publisher.states) == [STATE]
            said = b"".join(tap.heard[0][before:])
            assert said[1:].find(b"\x07MESSAGE") == 1  # one encrypted message, and no state in the clear
            assert b"small" not in b"".join(tap.heard[0])
            tap.say(0, said)  # again, in the same connection: its nonce was used
            with socket.create_connection(("127.0.0.1", port)) as again:  # and all of it, in a connection of its own
                again.sendall(b"".join(tap.heard[0]))
                until(lambda: send.publisher.refused["handshake"])
            time.sleep(0.2)
            assert send.publisher.states() == []


# --- sizes, rates and noise

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00"
READY_OF_A_PUB = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03PUB"
GIB = struct.pack(">Q", 1 << 30)


def memory() -> int:
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("keys", [None, DESK])
def test_a_message_of_a_gibibyte_is_cut_off_before_it_is_stored(keys):
    address = free_address()
    greeting = GREETING + (b"CURVE" if keys else b"NULL").ljust(20, b"\0") + bytes(32)
    claim = b"\x06" + GIB if keys else READY_OF_A_PUB + b"\x02" + GIB  # as a command, or as a message after READY
    with sending(keys, address) as send:
        before = memory()
        for where in ("frames", "hello", "stop", "state", "control"):
            port = int(getattr(endpoints(address), where).rpartition(":")[2])
            with socket.create_connection(("127.0.0.1", port), timeout=20) as stranger:
                with suppress(ConnectionError):  # it hangs up
                    stranger.sendall(greeting + claim)
                    for _ in range(200):
                        stranger.sendall(bytes(1 << 20))
                assert memory() - before < 100e6
        if keys:
            assert until(lambda: send.publisher.refused["handshake"] >= 5)
        with Receiver(address, rig_hash=RIG.hash, keys=keys and PI) as receiver:
            until(lambda: follows(send, receiver))


def damaged(rng: random.Random, message: bytes) -> bytes:
    """`message` after one to three blows."""
    data = bytearray(message)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(data) + 1)
        blow = rng.randrange(4)
        if blow == 0:
            data[at : at + 1] = rng.randbytes(1)
        elif blow == 1:
            del data[at : at + rng.randint(1, 20)]
        elif blow == 2:
            data[at:at] = rng.randbytes(rng.randint(1, 20))
        else:
            data[at : at + 1] = bytes([rng.choice([0x80, 0xC0, 0xC1, 0xCB, 0xD9, 0xDD, 0xDF, 0xFF])])
    return bytes(data)


@pytest.mark.parametrize("message", [STATE, Stop("a hand in the way"), hello_for(MOVE, RIG, REPORT, 1)])
def test_damaged_messages_are_refused_or_still_are_what_they_say(message):
    rng = random.Random(1)
    good = 0
    for _ in range(4000):
        data = damaged(rng, pack(message))
        said = ""
        try:
            read = unpack(data, type(message))
        except FrameError as error:
            said = str(error)
        else:
            good += 1
            assert unpack(pack(read), type(message)) == read
        assert said.isprintable()
    assert 0 < good < 2000


def test_noise_on_the_control_sockets_is_counted_to_the_last_message():
    address, rng, count = free_address(), random.Random(2), 400
    with sending(DESK, address) as send:
        curve = Curve(PI.secret, server=DESK.public)
        with sockets((zmq.PUB, endpoints(address).state, curve)) as [mouth]:
            until(lambda: mouth.send(pack(STATE)) or time.sleep(0.02) or send.publisher.states())
            time.sleep(0.1)
            while send.publisher.states():
                pass
            taken = []
            for _ in range(count):
                mouth.send(damaged(rng, pack(STATE)))
            until(lambda: taken.extend(send.publisher.states()) or len(taken) + _refused(send) == count)
            assert 0 < len(taken) < count / 2


def _refused(send: Sender) -> int:
    return send.publisher.refused["message"] + send.publisher.refused["rate"]


def test_noise_to_a_rig_is_counted_and_never_a_stop():
    address, rng = free_address(), random.Random(3)
    hello = hello_for(MOVE, RIG, REPORT, 1)
    with sending(None, address) as send, Receiver(address, rig_hash=RIG.hash) as receiver:
        until(lambda: follows(send, receiver))
        told = msgspec.msgpack.encode({"type": "rigcast.stop.1"})  # no reason: not a stop

        def enough():
            send.publisher._outlet.stop.send(rng.choice([told, rng.randbytes(30), pack(hello)]))
            send.publisher._outlet.hello.send(rng.choice([b"", rng.randbytes(30), pack(STATE)]))
            return follows(send, receiver) and receiver.gate.refused["message"] > 100

        until(enough)
        assert (receiver.watchdog.mode, receiver.hello) == ("following", hello)


class FrozenClock:
    """Time stands still."""

    def now_ns(self) -> int:
        return 100 * NS

    def sleep_until_ns(self, when_ns: int) -> None:
        raise NotImplementedError


def test_a_rig_that_talks_too_much_is_heard_no_more_than_it_may():
    address = free_address()
    with Publisher(hello_for(MOVE, RIG, REPORT, 1), address, clock=FrozenClock()) as publisher:
        with sockets((zmq.PUB, endpoints(address).state, None)) as [mouth]:
            heard = []
            until(lambda: mouth.send(pack(STATE)) or heard.extend(publisher.states()) or publisher.refused["rate"] > 50)
        assert len(heard) == MOST_STATES_PER_S


def test_the_rate_is_each_sender_s_own_and_comes_back_with_time():
    rate = Rate(10)
    assert [rate.allows("a", 5 * NS) for _ in range(12)] == [True] * 10 + [False] * 2
    assert rate.allows("b", 5 * NS)
    assert not rate.allows("a", 5 * NS + NS // 10 - 1)
    assert rate.allows("a", 5 * NS + NS // 10)
    assert not rate.allows("a", 5 * NS + NS // 10)
    assert sum(rate.allows("a", 60 * NS) for _ in range(50)) == 10


# --- passed on


def test_a_relay_passes_on_what_it_may_and_to_whom_it_may():
    middle = pair()
    desk, pi = knowing(DESK, relay=(middle, "follow control")), knowing(PI, relay=(middle, "lead"))
    middle = knowing(middle, desk=(DESK, "lead"), pi=(PI, "follow control"))
    source, address, ended, passed = free_address(), free_address(), threading.Event(), []

    def work():
        nothing = (lambda trouble: None,)
        passed.append(relay(source, address, ended.is_set, *nothing, keys=middle, source_keys=middle))

    thread = threading.Thread(target=work)
    with sending(desk, source) as send, Receiver(address, rig_hash=RIG.hash, keys=pi) as receiver:
        thread.start()
        try:
            until(lambda: follows(send, receiver))
            assert until(lambda: send() or receiver.send_state(STATE) or send.publisher.states())[0] == STATE
            send.publisher.stop("enough")
            until(lambda: receiver.poll(time.monotonic_ns()) or receiver.watchdog.mode == "stopped")
            with (
                Receiver(address, rig_hash=RIG.hash, keys=pi) as late,  # hears the hello and the stop all the same
                Receiver(address, rig_hash=RIG.hash, keys=STRANGER, leader="desk") as stranger,
            ):
                until(lambda: late.poll(time.monotonic_ns()) or (late.hello and late.watchdog.mode == "stopped"))
                until(lambda: stranger.poll(time.monotonic_ns()) or "not the leader's" in stranger.trouble)
                assert (stranger.gate.accepted, stranger.hello) == (0, None)
        finally:
            ended.set()
            thread.join()
    assert passed[0] > 3
