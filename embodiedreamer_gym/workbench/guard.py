"""Refuse requests from other web pages: a browser allows any page to open a websocket to this machine."""

from __future__ import annotations

import contextlib
import http
import importlib
import ipaddress
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import urlsplit

from embodiedreamer_gym.errors import EmbodieDreamerError

REFUSED = "Request refused: its Host or Origin header is not that of the workbench.\n"


def is_loopback(host: str) -> bool:
    """Whether an address or name, without a port, is always this machine."""
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


def is_own(hosts: Sequence[str], origins: Sequence[str], local: bool) -> bool:
    """Whether a request with these Host and Origin headers comes from the page itself, or not from a browser.

    local: the page is served only to this machine; its host must then be a loopback name, which no name server can
    assign to another page (DNS rebinding). The port may differ from the server's, because a tunnel such as `ssh -L` has
    its own.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return False
    try:
        address = urlsplit(f"//{hosts[0]}")
        origin = urlsplit(origins[0]).netloc if origins else address.netloc
        return origin == address.netloc and (not local or is_loopback(address.hostname or ""))
    except ValueError:
        return False


@contextlib.contextmanager
def refusing_others(host: str) -> Iterator[None]:
    """Make a websocket server started in this block answer 403 to all requests that do not come from its own page.

    viser takes no `process_request`, so `websockets.asyncio.server.serve` is replaced while viser starts its server.
    Raises: EmbodieDreamerError when no server was started this way: this version of viser would be open to other pages.
    """
    server = _websockets()
    local, serve, guards = is_loopback(host), server.serve, []

    def guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            headers = request.headers
            if is_own(headers.get_all("Host"), headers.get_all("Origin"), local):
                return process_request(connection, request)
            return connection.respond(http.HTTPStatus.FORBIDDEN, REFUSED)

        guards.append(answer)
        return serve(*arguments, process_request=answer, **options)

    server.serve = guarded
    try:
        yield
    finally:
        server.serve = serve
    if not guards:
        raise EmbodieDreamerError("this version of viser cannot refuse requests from other pages; install viser 1.1.")


def _websockets() -> Any:
    return importlib.import_module("websockets.asyncio.server")
