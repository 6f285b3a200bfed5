"""Who is heard, when it came, and what is turned away, over real sockets."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest
import zmq
from pythonosc.udp_client import SimpleUDPClient
from small_rig import free_address

from drivers.clock import MonotonicClock
from drivers.endpoint import StreamError
from drivers.inbox import MOST, SILENT_NS, Heard, Inbox
from drivers.osc import messages_in


class Clock(MonotonicClock):
    """The machine's, ahead by `by_ns`."""

    by_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self.by_ns


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(condition: Callable[[], object], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_datagrams_come_in_order_with_their_times_and_of_one_sender_alone() -> None:
    port, clock = free_port(), Clock()
    with Inbox(f"vmc://:{port}", clock) as inbox:
        ours, other = (SimpleUDPClient("127.0.0.1", port) for _ in range(2))
        before = clock.now_ns()
        for k in range(3):
            ours.send_message("/VMC/Ext/T", float(k))
        heard: list[Heard] = []
        until(lambda: heard.extend(inbox.take()) or len(heard) == 3)
        assert [messages_in(each.data)[0].args for each in heard] == [(0.0,), (1.0,), (2.0,)]
        assert before <= heard[0].at_ns <= heard[2].at_ns <= clock.now_ns()
        other.send_message("/VMC/Ext/T", 9.0)
        until(lambda: inbox.refused["foreign"])
        assert inbox.foreigner.startswith("127.0.0.1:")
        assert inbox.foreigner != heard[0].sender
        assert inbox.take() == []
        clock.by_ns = SILENT_NS + 1_000_000  # the first has been silent
        other.send_message("/VMC/Ext/T", 9.0)
        until(lambda: heard.extend(inbox.take()) or len(heard) == 4)
        ours._sock.close()
        other._sock.close()


def test_who_is_not_the_one_who_is_allowed_is_never_heard() -> None:
    port = free_port()
    with Inbox(f"vmc://*:{port}", Clock(), sender="192.0.2.7") as inbox:
        stranger = SimpleUDPClient("127.0.0.1", port)
        stranger.send_message("/VMC/Ext/T", 0.0)
        until(lambda: inbox.refused["foreign"])
        assert inbox.take() == []
        stranger._sock.close()


def test_a_flood_loses_the_oldest_and_fills_no_memory() -> None:
    port = free_port()
    with Inbox(f"vmc://:{port}", Clock()) as inbox, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:

        def flooded() -> bool:
            for _ in range(50):
                mouth.sendto(bytes(60_000), ("127.0.0.1", port))
            return inbox.refused["flood"] > 100

        until(flooded)
        assert len(inbox.take()) <= MOST


def test_sonic_is_subscribed_to_by_its_topic() -> None:
    address = free_address()
    with zmq.Context() as context, context.socket(zmq.PUB) as mouth:
        mouth.setsockopt(zmq.LINGER, 0)
        mouth.bind(address)
        with Inbox(address.replace("tcp", "sonic"), Clock()) as inbox:
            heard: list[Heard] = []

            def came() -> bool:
                mouth.send(b"other")
                mouth.send(b"pose and more")
                heard.extend(inbox.take())
                return len(heard) > 2

            until(came)
    assert {each.data for each in heard} == {b"pose and more"}


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("vmc://*:39539", r"--sender IP, or --insecure"),
        ("vmc://192.0.2.1:39539", r"--sender IP, or --insecure"),
        ("sonic://192.0.2.1:5556", "--insecure"),
        ("sonic://:5556", "source 'sonic://:5556': give vmc://:39539"),
        ("osc://:9000", r"give .* or sonic://HOST:PORT"),
        ("vmc://:99999", "vmc://:99999"),
        ("", "source ''"),
    ],
)
def test_a_wrong_source_is_one_clear_line(source: str, words: str) -> None:
    with pytest.raises(StreamError, match=words) as caught:
        Inbox(source, Clock())
    assert "\n" not in str(caught.value)


def test_a_port_that_is_taken_is_named() -> None:
    port = free_port()
    with Inbox(f"vmc://:{port}", Clock()), pytest.raises(StreamError, match=f"{port} is busy"):
        Inbox(f"vmc://:{port}", Clock())
