"""Only its own page, opened by its whole address, gets anything from the server of the web view."""

from __future__ import annotations

import socket
import sys
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import pytest

viser = pytest.importorskip("viser", reason="needs rigcast[web]")
from websockets.exceptions import InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from sim.guarded import guarded_server  # noqa: E402

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def address():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with guarded_server(port, "test") as (_, where):
        yield where


def status(url: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def socket_status(address: str, origin: str | None) -> int:
    """101 where the WebSocket opens and speaks, else the refusal."""
    try:
        with connect(address.replace("http:", "ws:"), origin=origin, subprotocols=[PROTOCOL], proxy=None) as opened:
            assert len(opened.recv(timeout=10)) > 0
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def base(address: str) -> str:
    return f"http://{urlsplit(address).netloc}"


def test_the_whole_address_opens_the_page_and_its_socket(address):
    assert status(address) == 200
    assert status(address, Origin=base(address)) == 200
    assert socket_status(address.rstrip("/"), base(address)) == 101  # the page's own, which leaves the last / out
    assert socket_status(address, None) == 101


@pytest.mark.parametrize("rest", ["", "/", "/index.html", "/x/", "/?token", "/%00/"])
def test_without_the_token_there_is_nothing(address, rest):
    assert status(base(address) + rest) == 403
    assert socket_status(base(address) + rest, base(address)) == 403


def test_nearly_the_token_is_not_the_token(address):
    for wrong in (address[:-2], address[:-2] + "//", f"{base(address)}/x{urlsplit(address).path[1:]}"):
        assert status(wrong) == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1"])
def test_another_page_gets_nothing_even_with_the_token(address, origin):
    assert status(address, Origin=origin) == 403
    assert socket_status(address, origin) == 403


def test_the_address_is_told_to_nobody_and_new_each_time(address):
    with urllib.request.urlopen(address) as answer:
        assert answer.headers["Referrer-Policy"] == "no-referrer"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with guarded_server(port, "another") as (_, other):
        assert len(urlsplit(other).path) == len(urlsplit(address).path) == 24
        assert urlsplit(other).path != urlsplit(address).path


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a machine has one loopback address")
def test_only_this_machine_is_listened_to(address):
    with socket.socket() as probe, pytest.raises(OSError, match="refused"):
        probe.connect(("127.0.0.2", urlsplit(address).port))  # also this machine, by another of its addresses
