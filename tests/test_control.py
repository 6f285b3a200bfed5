"""The control socket over real ones: who may ask, who may only stop, and what strangers can do there."""

from __future__ import annotations

import os
import random
import socket
import time
from collections import Counter
from contextlib import contextmanager, suppress

import msgspec
import pytest
import zmq
from small_rig import REPORT, free_address
from tap import Tap
from test_security import DESK, MOVE, PI, RIG, STRANGER, damaged, knowing, memory, pair, sending, sockets, until

from drivers.caller import ControlLine
from drivers.control import Look, Rest, Say, Status, Told, request_in
from drivers.endpoint import StreamError, endpoints
from drivers.frame import FrameError
from drivers.messages import RigState, Stop, pack
from drivers.metrics import rendered
from drivers.publisher import MOST_REQUESTS_PER_S, publish
from drivers.receiver import Receiver
from drivers.sockets import Curve
from rigcast.service.figures import figures

PHONE, SCREEN = pair(), pair()
HOST = knowing(DESK, pi=(PI, "follow control"), phone=(PHONE, "say"), screen=(SCREEN, "follow"))
PHONE, SCREEN = (knowing(keys, desk=(DESK, "lead")) for keys in (PHONE, SCREEN))


@contextmanager
def lines(address: str, *keys):
    """A control line with each of `keys`, and what each was answered so far."""
    with ControlLine(address, keys=keys[0]) as first:
        if len(keys) == 1:
            yield [first]
        else:
            with lines(address, *keys[1:]) as rest:
                yield [first, *rest]


def answered(line: ControlLine):
    """What `line` has been answered just now, or None."""
    return next(line.answers(lambda: not line._line.socket.poll(1), 1e9), None)


def test_a_key_that_may_say_is_heard_by_name_and_others_are_told_why_not():
    address = free_address()
    with sending(HOST, address) as send, lines(address, PHONE, SCREEN, PI) as (phone, screen, pi):
        for line, id in ((phone, "p"), (screen, "s"), (pi, "r")):
            line.ask(Say(id, "wave", sender="owner"))
        heard, told = [], []

        def all_spoke():
            heard.extend(send.publisher.requests())
            told.extend(filter(None, (answered(line) for line in (screen, pi))))
            return heard and len(told) == 2

        until(all_spoke)
        [(caller, request)] = heard
        assert (caller.name, request.id) == ("phone", "p")
        assert {t.event for t in told} == {"refused"}
        assert "'screen' may not say" in " ".join(t.detail for t in told)
        send.publisher.tell(caller, Told("p", "queued"))
        assert until(lambda: answered(phone)) == Told("p", "queued")


def test_who_vanishes_in_the_middle_is_nobodys_trouble():
    address = free_address()
    with sending(HOST, address) as send, lines(address, SCREEN) as [screen]:
        with lines(address, PHONE) as [phone]:
            phone.ask(Say("p", "wave", sender="owner"))
            [(caller, _)] = until(send.publisher.requests)
        for _ in range(2000):  # more than wait in a socket
            send.publisher.tell(caller, Told("p", "playing"))
        before = send.publisher.hello
        send()
        screen.ask(Look("l"))
        [(other, request)] = until(send.publisher.requests)
        assert (other.name, request, send.publisher.hello) == ("screen", Look("l"), before)


def test_every_key_may_look_and_stop():
    address = free_address()
    with (
        sending(HOST, address) as send,
        lines(address, SCREEN) as [screen],
        Receiver(address, rig_hash=RIG.hash, keys=PI) as rig,
    ):
        screen.ask(Look("l"))
        [(caller, request)] = until(send.publisher.requests)
        assert (caller.name, request) == ("screen", Look("l"))
        screen.ask(Stop("a hand is in the way"))
        until(lambda: send.publisher.requests() or send.publisher.stopped)

        def rig_stopped():
            send()
            rig.poll(time.monotonic_ns())
            return rig.watchdog.mode == "stopped"

        until(rig_stopped)
        assert rig.watchdog.reason == "stop: a hand is in the way (screen)"
        assert until(lambda: answered(screen)).event == "stopped"


def test_a_stranger_asks_nothing_and_an_impostor_is_told_nothing():
    address = free_address()
    stranger = knowing(STRANGER, desk=(DESK, "lead"))
    with sending(HOST, address) as send, lines(address, stranger) as [line]:
        line.ask(Say("s", "wave"))
        line.ask(Stop("I say so"))

        def was_refused():
            assert send.publisher.requests() == []
            answered(line)
            line._line.tend(time.monotonic_ns())
            return send.publisher.refused["stranger"] >= 3

        until(was_refused)
        assert send.publisher.stopped == ""
        with pytest.raises(StreamError, match="does not allow this machine's key"):
            next(line.answers(lambda: False, 0.0))
    with sending(STRANGER, address), lines(address, PHONE) as [phone]:
        phone.ask(Say("p", "wave"))
        until(lambda: answered(phone) or "not the leader's" in phone.trouble or phone._line.tend(time.monotonic_ns()))


def test_noise_is_counted_and_a_flood_does_not_keep_a_stop_out():
    address = free_address()
    rng = random.Random(3)
    with sending(None, address) as send, sockets((zmq.DEALER, endpoints(address).control, None)) as [mouth]:
        count = 400
        good = pack(Say("a", "wave"))
        for _ in range(count):
            noise = rng.choice([rng.randbytes(rng.randrange(300)), good[: rng.randrange(len(good))], b"\x93NUMPY"])
            mouth.send(noise)
            send.publisher.requests()
        until(lambda: send.publisher.requests() or send.publisher.refused["message"] == count)
        heard = []
        for _ in range(MOST_REQUESTS_PER_S + 100):
            mouth.send(good)
        mouth.send(pack(Stop("now")))
        until(lambda: heard.extend(send.publisher.requests()) or send.publisher.stopped)
        assert send.publisher.stopped == "now"
        assert MOST_REQUESTS_PER_S <= len(heard) <= 2 * MOST_REQUESTS_PER_S  # it may have taken a moment
        mouth.send_multipart([good, good])
        until(lambda: send.publisher.requests() or send.publisher.refused["message"] == count + 1)


def test_a_recording_of_a_prompt_says_nothing_again():
    address = free_address()
    port = int(endpoints(address).control.rpartition(":")[2])
    with sending(HOST, address) as send, Tap(port) as tap:
        curve = Curve(PHONE.secret, server=DESK.public)
        with sockets((zmq.DEALER, f"tcp://127.0.0.1:{tap.port}", curve)) as [mouth]:
            mouth.send(pack(Say("a", "wave")))
            assert len(until(send.publisher.requests)) == 1
            before = len(tap.heard[0])
            mouth.send(pack(Say("b", "wave")))
            assert len(until(send.publisher.requests)) == 1
            said = b"".join(tap.heard[0][before:])
            assert b"wave" not in b"".join(tap.heard[0])
            tap.say(0, said)  # again, in the same connection: its nonce was used
            with socket.create_connection(("127.0.0.1", port)) as again:  # and all of it, in a connection of its own
                again.sendall(b"".join(tap.heard[0]))
                until(lambda: send.publisher.refused["handshake"])
            time.sleep(0.2)
            assert send.publisher.requests() == []


@pytest.mark.parametrize("message", [Say("a", "wave", 3.0, 1, 2.0), Rest("b", "me"), Look("c"), Stop("enough")])
def test_damaged_requests_are_refused_or_still_are_what_they_say(message):
    rng, good = random.Random(1), 0
    for _ in range(2000):
        with suppress(FrameError):
            read = request_in(damaged(rng, pack(message)))
            good += 1
            assert request_in(pack(read)) == read
    assert 0 < good < 1000


def test_fuzzed_messages_are_counted_and_leave_nothing_behind():
    address, rng, count = free_address(), random.Random(4), 5_000  # benchmarks/soak.py sends 10⁵
    samples = [pack(m) for m in (Say("a", "wave"), Rest("b"), Look("c"))]
    noise = [damaged(rng, rng.choice(samples)) for _ in range(1000)]
    with sending(None, address) as send, sockets((zmq.DEALER, endpoints(address).control, None)) as [mouth]:
        sent = taken = 0

        def all_came():
            nonlocal sent, taken
            with suppress(zmq.Again):
                for _ in range(500 if sent < count else 0):
                    mouth.send(noise[sent % len(noise)], zmq.NOBLOCK)
                    sent += 1
            taken += len(send.publisher.requests())
            refused = send.publisher.refused
            return taken + refused["message"] + refused["rate"] == count

        until(lambda: all_came() or sent > count // 10)
        before, files = memory(), len(os.listdir("/proc/self/fd"))
        until(all_came, 100.0)
        assert send.publisher.refused["message"] > count // 2
        assert memory() - before < 5e6
        assert len(os.listdir("/proc/self/fd")) < files + 10  # not one for each message
        mouth.send(pack(Stop("still here")))
        until(lambda: send.publisher.requests() or send.publisher.stopped)


def test_what_is_turned_away_is_in_the_figures():
    address = free_address()
    control = endpoints(address).control
    ours, strange = Curve(PI.secret, server=DESK.public), Curve(STRANGER.secret, server=DESK.public)
    status = Status("", "small", "", "idle", "", "", 0.0, (), "", ())
    with (
        sending(HOST, address) as send,
        sockets((zmq.DEALER, control, ours), (zmq.DEALER, control, strange)) as [noisy, stranger],
    ):

        def shown() -> dict[str, float]:
            send.publisher.requests()
            page = rendered(figures(status, send.publisher, Counter(), {}, 0))
            lines = [line.partition("} ") for line in page.splitlines() if line.startswith("rigcast_refused_total{")]
            return {why.partition('"')[2].rstrip('"'): float(count) for why, _, count in lines}

        for _ in range(5):
            noisy.send(b"\x93NUMPY")
        with suppress(zmq.Again):
            stranger.send(pack(Look("a")), zmq.NOBLOCK)
        until(lambda: time.sleep(0.02) or (shown().get("message") == 5 and shown().get("stranger", 0) > 0))


def test_a_stream_without_a_service_ends_at_a_stop_and_at_a_rig_that_trips():
    for why in ("stop", "trip"):
        address = free_address()
        at = endpoints(address)
        with sockets((zmq.DEALER, at.control, None), (zmq.PUB, at.state, None)) as [control, state]:

            class Clock:
                """Says its word once the stream is under way."""

                def now_ns(self):
                    return time.monotonic_ns()

                def sleep_until_ns(self, when_ns, why=why, control=control, state=state):
                    time.sleep(max(0.0, (when_ns - time.monotonic_ns()) * 1e-9))
                    if why == "stop":
                        control.send(pack(Stop("enough")))
                    else:
                        state.send(pack(RigState("small", 1, "tripped", "hot", 0, 0, (0.0,))))

            done = publish(MOVE, RIG, REPORT, address, clock=Clock())
        assert done.ended == ("stopped: enough" if why == "stop" else "small is tripped: hot")
        assert done.frames < 51 + 3


def test_what_rigs_tell_reaches_those_who_watch():
    address = free_address()
    told = RigState("small", RIG.hash, "following", "", 3, 4, (0.1, 0.2, 0.3), run=9)
    with (
        sending(None, address) as send,
        Receiver(address, rig_hash=RIG.hash) as rig,
        Receiver(address, rig_hash=RIG.hash, preview=True) as screen,
    ):

        def seen():
            send()
            rig.send_state(told)
            send.publisher.states()
            screen.poll(time.monotonic_ns())
            return list(screen.roster)

        assert until(seen)[0].state == told
        until(lambda: seen() and screen.hello)


def test_answers_travel_whole():
    status = Status("i", "puppet", "mdm", "idle", "", "", 0.0, ("wave",), "desk", ())
    assert msgspec.msgpack.decode(pack(status), type=Status) == status
