"""Requests of other pages are refused, and every answer has the headers that keep other pages out."""

import base64
import hashlib

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from hand_recon.page.guard import LOOPBACK, Guard, policy_of
from hand_recon.page.routes import STATIC


def client(*names: str) -> TestClient:
    """A client of a page that only says that it was reached."""

    async def reached(request: Request) -> PlainTextResponse:
        return PlainTextResponse("reached")

    async def socket(connection: WebSocket) -> None:
        await connection.accept()
        await connection.send_text("reached")
        await connection.close()

    app = Starlette(
        routes=[
            Route("/", reached, methods=["GET", "POST"]),
            WebSocketRoute("/socket", socket),
        ]
    )
    guard = Guard(app, names=names or LOOPBACK, policy="default-src 'none'")
    return TestClient(guard, base_url="http://127.0.0.1:8765")


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:8765", "localhost:9000", "LOCALHOST", "[::1]:8765"]
)
def test_this_machine_by_any_of_its_names_is_answered(host: str) -> None:
    answer = client().get("/", headers={"host": host})
    assert (answer.status_code, answer.text) == (200, "reached")


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example:8765", "evil.example@127.0.0.1", "", "[::1", "0"],
)
def test_a_name_that_leads_here_from_elsewhere_is_refused(host: str) -> None:
    """DNS rebinding: the page evil.example has its name resolved to 127.0.0.1."""
    answer = client().get("/", headers={"host": host})
    assert answer.status_code == 403
    assert "expected 127.0.0.1, ::1, localhost. Open the address" in answer.json()["error"]


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "http://localhost:8765",
        "http://127.0.0.1:9999",
        "x",
        "http://[",
    ],
)
def test_a_request_of_another_page_is_refused(origin: str) -> None:
    answer = client().post("/", headers={"origin": origin, "host": "127.0.0.1:8765"})
    assert answer.status_code == 403
    assert "expected this page alone" in answer.json()["error"]


def test_requests_of_this_page_and_of_programs_are_answered() -> None:
    assert client().post("/", headers={"origin": "http://127.0.0.1:8765"}).status_code == 200
    assert client().post("/").status_code == 200


def test_a_name_that_was_allowed_is_answered() -> None:
    named = client("workstation")
    assert named.get("/", headers={"host": "workstation:8765"}).status_code == 200
    assert named.get("/", headers={"host": "127.0.0.1"}).status_code == 403


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"host": "evil.example"}])
def test_a_socket_of_another_page_is_refused(headers: dict[str, str]) -> None:
    with (
        pytest.raises(WebSocketDisconnect) as refused,
        client().websocket_connect("/socket", headers=headers),
    ):
        pass
    assert refused.value.code == 1008


def test_a_socket_of_this_page_is_answered() -> None:
    headers = {"origin": "http://127.0.0.1:8765", "host": "127.0.0.1:8765"}
    with client().websocket_connect("/socket", headers=headers) as socket:
        assert socket.receive_text() == "reached"


@pytest.mark.parametrize("path", ["/", "/missing"])
def test_every_answer_has_the_headers(path: str) -> None:
    answer = client().get(path)
    assert answer.headers["content-security-policy"] == "default-src 'none'"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-store"


def policy_part(policy: str, name: str) -> str:
    return next(part for part in policy.split("; ") if part.startswith(name))


def test_the_policy_allows_this_server_and_the_import_map_alone() -> None:
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    policy = policy_of(page)
    assert "http" not in policy
    assert "unsafe" not in policy
    (text,) = [part.partition("</script>")[0] for part in page.split('"importmap">')[1:]]
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    assert policy_part(policy, "script-src") == f"script-src 'self' 'sha256-{digest}'"
