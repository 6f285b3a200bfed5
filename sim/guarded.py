"""A viser server that only who was given its address gets to see: no program that guesses, no other site's page."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from io import StringIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser
    from websockets import Headers
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

LOCAL = "127.0.0.1"  # nobody else on the network gets to see it
TOKEN_BYTES = 16
TAKEN = "port {port} is taken; choose another with --port"
NOT_ALLOWED = b"403: open the address that rigcast printed, with all that comes after the port\n"


@contextmanager
def guarded_server(port: int, label: str) -> Iterator[tuple[viser.ViserServer, str]]:
    """A server on this machine alone, and the address of its page, which ends in a random token.

    Any request, the WebSocket's too, without the token or with another page's Origin gets 403. Raises RuntimeError
    where the port is taken.
    """
    import viser
    import websockets.asyncio.server
    from websockets.asyncio.server import ServerConnection

    token = secrets.token_urlsafe(TOKEN_BYTES)

    class Guarded(ServerConnection):
        async def handshake(self, process_request=None, process_response=None, server_header=None) -> None:  # type: ignore[no-untyped-def]
            await super().handshake(partial(_let_in, token, port, process_request), process_response, server_header)

    serve = websockets.asyncio.server.serve
    with redirect_stdout(StringIO()):  # viser prints an address that lacks the token
        # viser has no way to pass a class of connections on; it serves before it returns.
        websockets.asyncio.server.serve = partial(serve, create_connection=Guarded)  # type: ignore[assignment, misc]
        try:
            server = viser.ViserServer(host=LOCAL, port=port, label=label, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
        try:
            if server.get_port() != port:  # viser quietly takes the next one
                raise RuntimeError(TAKEN.format(port=port))
            server.gui.configure_theme(show_share_button=False)  # which would put the page on the open net
            yield server, f"http://{LOCAL}:{port}/{token}/"
        finally:
            server.stop()


def require_port(port: int) -> None:
    """Raise RuntimeError where `port` is taken on this machine, before anything is made to be shown there."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # what was closed a moment ago does not take it
        try:
            probe.bind((LOCAL, port))
        except OSError:
            raise RuntimeError(TAKEN.format(port=port)) from None


def _let_in(
    token: str,
    port: int,
    answer: Callable[[ServerConnection, Request], Response | None] | None,
    connection: ServerConnection,
    request: Request,
) -> Response | None:
    """What viser answers to a request that may pass, with the token taken out of its path; else 403."""
    from websockets import Headers
    from websockets.http11 import Response

    given, _, path = request.path.partition("?")[0].removeprefix("/").partition("/")
    if not secrets.compare_digest(given.encode(), token.encode()) or not _own(request.headers, port):
        headers = Headers(
            {"Content-Type": "text/plain", "Content-Length": str(len(NOT_ALLOWED)), "Connection": "close"}
        )
        return Response(HTTPStatus.FORBIDDEN, HTTPStatus.FORBIDDEN.phrase, headers, NOT_ALLOWED)
    response = None if answer is None else answer(connection, replace(request, path=f"/{path}"))
    if response is not None:
        response.headers["Referrer-Policy"] = "no-referrer"  # the address is the key
    return response


def _own(headers: Headers, port: int) -> bool:
    """Whether the page that asks is the server's own; programs other than browsers do not say."""
    own = {f"http://{host}:{port}" for host in (LOCAL, "localhost")}
    return all(origin in own for origin in headers.get_all("Origin"))
