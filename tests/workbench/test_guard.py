"""Another page in the same browser, or a name that was given this machine's address, cannot reach the workbench."""

from __future__ import annotations

import http.client
from contextlib import closing

import pytest

pytest.importorskip("viser", reason="viser is not installed")

import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.workbench.guard import is_own, refusing_others
from embodiedreamer_gym.workbench.serve import serve

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def port():
    server = serve("127.0.0.1", 0)
    yield server.get_port()
    server.stop()


def hears(port: int, origin: Origin | None, host: str = "127.0.0.1") -> bool:
    """Whether a websocket with that Origin and Host gets the page's messages."""
    with connect(f"ws://{host}:{port}", origin=origin, subprotocols=[PROTOCOL]) as client:
        return len(client.recv(timeout=10.0)) > 0


def status(port: int, **headers: str) -> int:
    """Status of the answer to a request for the page."""
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)) as connection:
        connection.request("GET", "/", headers=headers)
        return connection.getresponse().status


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_the_pages_own_websocket_is_served(port: int, host: str) -> None:
    assert hears(port, Origin(f"http://{host}:{port}"), host)


def test_a_client_that_is_no_browser_is_served(port: int) -> None:
    assert hears(port, None)


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "http://localhost:{port}", "null"])
def test_the_websocket_of_another_page_is_refused(port: int, origin: str, caplog) -> None:
    with pytest.raises(InvalidStatus) as refused:
        hears(port, Origin(origin.format(port=port)))
    assert refused.value.response.status_code == 403
    assert [r for r in caplog.records if r.levelname in ("WARNING", "ERROR")] == []


def test_pages_are_guarded_as_websockets_are(port: int) -> None:
    assert status(port) == 200
    assert status(port, Host=f"localhost:{port}", Origin=f"http://localhost:{port}") == 200
    assert status(port, Origin="http://evil.example") == 403
    assert status(port, Host=f"evil.example:{port}") == 403
    assert status(port, Host=f"evil.example:{port}", Origin=f"http://evil.example:{port}") == 403


@pytest.mark.parametrize(
    ("hosts", "origins", "local", "expected"),
    [
        (["[::1]:8080"], ["http://[::1]:8080"], True, True),
        (["localhost:9000"], ["http://localhost:9000"], True, True),  # through a tunnel
        (["localhost.evil.example:8080"], [], True, False),
        (["127.0.0.1@evil.example:8080"], [], True, False),
        (["[::1"], [], True, False),
        ([], [], True, False),
        (["localhost:8080"] * 2, [], True, False),
        (["localhost:8080"], ["http://localhost:8080", "http://evil.example"], True, False),
        (["robot.lab:8080"], ["http://robot.lab:8080"], False, True),
        (["robot.lab:8080"], ["http://evil.example"], False, False),
    ],
)
def test_headers(hosts: list[str], origins: list[str], local: bool, expected: bool) -> None:
    assert is_own(hosts, origins, local) == expected


def test_a_server_that_was_not_guarded_is_an_error() -> None:
    with pytest.raises(EmbodieDreamerError, match="cannot refuse requests from"), refusing_others("127.0.0.1"):
        pass
