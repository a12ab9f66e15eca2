"""Server of a folder on this machine, which serves ranges, fails on demand and notes what was asked for."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path


@dataclass
class Served:
    """A folder behind a URL."""

    folder: Path
    url: str = ""
    """Address of the folder, with a slash at its end."""
    ranges: bool = True
    """False answers requests for ranges with the whole file."""
    failures: list[int | str] = field(default_factory=list)
    """Faults of the next answers: a status, `cut` for half of the bytes, or `other` for other ones."""
    asked: list[tuple[str, str]] = field(default_factory=list)
    """Name and range of each request."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def __init__(self, served: Served, *arguments: object) -> None:
        self.served = served
        super().__init__(*arguments)  # type: ignore[arg-type]  # those of the server

    def do_GET(self) -> None:
        """Serve a file or a range of it."""
        name, wanted = self.path.removeprefix("/"), self.headers.get("Range", "")
        self.served.asked.append((name, wanted))
        failure = self.served.failures.pop(0) if self.served.failures else None
        path = self.served.folder / name
        if isinstance(failure, int) or not path.is_file():
            self._answer(failure if isinstance(failure, int) else 404, b"")
            return
        content = path.read_bytes()
        if wanted and self.served.ranges:
            first, last = wanted.removeprefix("bytes=").split("-")
            content = content[int(first) : int(last) + 1]
        if failure == "other":
            content = bytes(len(content))
        self._answer(206 if wanted and self.served.ranges else 200, content, failure == "cut")

    def _answer(self, status: int, content: bytes, cut: bool = False) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content[: len(content) // 2] if cut else content)
        self.close_connection = cut

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@contextmanager
def serving(folder: Path) -> Iterator[Served]:
    """Serve a folder at a free port of this machine until the end of the block.

    Args:
        folder: The folder.
    """
    served = Served(folder)
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, served))
    served.url = f"http://127.0.0.1:{server.server_address[1]}/"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield served
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
