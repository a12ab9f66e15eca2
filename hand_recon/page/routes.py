"""Routes of the page: its files, uploads, downloads, a video's result, and the webcam."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from hand_recon import __version__
from hand_recon.page.bounds import Bounds
from hand_recon.page.downloads import Download
from hand_recon.page.guard import Guard, policy_of
from hand_recon.page.kept_results import ForgottenError
from hand_recon.page.knowledge_rows import ROWS
from hand_recon.page.webcam import webcam
from hand_recon.page.worker import BusyError, TookTooLongError, Worker, WorkerEndedError

STATIC: Final = Path(__file__).parent / "static"
"""Folder of the page's files."""


class TooLargeError(ValueError):
    """An upload with more bytes than are taken."""


@dataclass(frozen=True)
class PageSettings:
    """Settings of the page besides the fits."""

    bounds: Bounds = field(default_factory=Bounds)
    """Bounds of uploads."""
    names: tuple[str, ...] = ("127.0.0.1", "localhost", "::1")
    """Host names and addresses of the server."""
    hands_file: Path | None = None
    """File of hands that the page opens with; None for none."""
    video: Path | None = None
    """Video beside it; None for none."""
    examples: tuple[Path, ...] = ()
    """Photographs that the page offers as examples."""


_STATUS: Final = {
    TooLargeError: 413,
    BusyError: 503,
    TookTooLongError: 504,
    WorkerEndedError: 500,
    ForgottenError: 410,
    ModuleNotFoundError: 501,
    ValueError: 422,
}
"""Status of the answer by kind of error, the narrowest first."""


def page_app(worker: Worker, settings: PageSettings) -> Starlette:
    """Application of the page.

    Args:
        worker: Does the work.
        settings: Bounds, names and files.
    """
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    routes = _Routes(worker, settings, page)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await worker.close()

    guard = Middleware(Guard, names=settings.names, policy=policy_of(page))
    return Starlette(
        routes=[
            Route("/", routes.page),
            Route("/api/about", _told(routes.about)),
            Route("/api/file", _told(routes.file), methods=["POST"]),
            Route("/api/example/{number:int}", _told(routes.example), methods=["POST"]),
            Route("/api/opened", _told(routes.opened), methods=["POST"]),
            Route("/api/rows/{number:int}", _told(routes.rows)),
            Route("/api/frames/{number:int}", _told(routes.frames)),
            Route("/api/download/{number:int}/{row}/{format}", _told(routes.download)),
            Route("/api/video", _told(routes.video)),
            WebSocketRoute("/api/live", webcam(worker, settings.bounds)),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[guard],
        lifespan=lifespan,
    )


Endpoint = Callable[[Request], Awaitable[Response]]


def _told(endpoint: Endpoint) -> Endpoint:
    """Turn the errors of an endpoint into answers with a sentence."""

    async def answering(request: Request) -> Response:
        try:
            return await endpoint(request)
        except tuple(_STATUS) as error:
            status = next(code for kind, code in _STATUS.items() if isinstance(error, kind))
            return JSONResponse({"error": str(error)}, status_code=status)
        except ClientDisconnect:
            return Response(status_code=400)
        except Exception as error:  # noqa: BLE001  # one file never takes the page down
            text = (
                f"The file could not be worked on ({type(error).__name__}: {str(error)[:200]}); expected a "
                "photograph, landmarks or a file of hands. Please report this with the file."
            )
            return JSONResponse({"error": text}, status_code=500)

    return answering


class _Routes:
    """Endpoints of the page."""

    def __init__(self, worker: Worker, settings: PageSettings, page: str) -> None:
        self.worker, self.settings, self.html = worker, settings, page
        self.model: dict[str, Any] | None = None
        self.uploads = 0

    async def page(self, request: Request) -> Response:
        return HTMLResponse(self.html)

    async def about(self, request: Request) -> Response:
        # Once, so that the page opens whatever else is worked on.
        if self.model is None:
            self.model = await self.worker.call("about")
        rows = [{"key": row.key, "title": row.title, "sentence": row.sentence} for row in ROWS]
        opened = self.settings.hands_file
        return JSONResponse(
            self.model
            | {
                "version": __version__,
                "rows": rows,
                "bounds": asdict(self.settings.bounds),
                "examples": [path.name for path in self.settings.examples],
                "opened": None if opened is None else opened.name,
                "has_video": self.settings.video is not None,
            }
        )

    async def file(self, request: Request) -> Response:
        name = request.query_params.get("name", "file")[:300]
        most = self.settings.bounds.waiting + 1
        if self.uploads >= most:
            raise BusyError(
                f"{self.uploads} files are being sent or worked on; expected at most {most} at a time. Try "
                "again in a few seconds."
            )
        self.uploads += 1
        try:
            content = await self._body(request)
            return JSONResponse(await self.worker.call("file", name, content))
        finally:
            self.uploads -= 1

    async def example(self, request: Request) -> Response:
        number = request.path_params["number"]
        if number >= len(self.settings.examples):
            raise ForgottenError(f"There is no example {number}. Give a file of your own.")
        path = self.settings.examples[number]
        content = await asyncio.to_thread(path.read_bytes)
        return JSONResponse(await self.worker.call("file", path.name, content))

    async def opened(self, request: Request) -> Response:
        if self.settings.hands_file is None:
            raise ForgottenError(
                "No results were given. Start the page with a folder: hand-recon demo outputs/clip."
            )
        return JSONResponse(await self.worker.call("hands_file", str(self.settings.hands_file)))

    async def rows(self, request: Request) -> Response:
        return JSONResponse(await self.worker.call("rows", request.path_params["number"]))

    async def frames(self, request: Request) -> Response:
        first, count = (_whole(request, key) for key in ("first", "count"))
        number = request.path_params["number"]
        return JSONResponse(await self.worker.call("frames", number, first, count))

    async def download(self, request: Request) -> Response:
        asked = request.path_params
        found: Download = await self.worker.call(
            "download", asked["number"], asked["row"], asked["format"]
        )
        disposition = f"attachment; filename*=UTF-8''{quote(found.name)}"
        return Response(
            found.content,
            media_type="application/octet-stream",
            headers={"content-disposition": disposition},
        )

    async def video(self, request: Request) -> Response:
        if self.settings.video is None:
            raise ForgottenError("There is no video beside these results.")
        return FileResponse(self.settings.video)

    async def _body(self, request: Request) -> bytes:
        """Content of an upload, read no further than to its bound.

        Raises:
            TooLargeError: It is larger.
            TookTooLongError: It does not come in time.
        """
        most = self.settings.bounds.file_bytes
        refusal = TooLargeError(
            f"The file has more than {most / 1e6:g} MB; expected at most that. Scale the photograph down, or "
            "start the page with a larger bounds.megabytes."
        )
        if int(request.headers.get("content-length") or 0) > most:
            raise refusal
        content = bytearray()
        try:
            async with asyncio.timeout(self.settings.bounds.seconds):
                async for part in request.stream():
                    content += part
                    if len(content) > most:
                        raise refusal
        except TimeoutError as error:
            raise TookTooLongError(
                f"After {self.settings.bounds.seconds:g} seconds, {len(content)} bytes of the file had come; "
                "expected all of it. Send it again."
            ) from error
        return bytes(content)


def _whole(request: Request, key: str) -> int:
    """A whole number of the query.

    Raises:
        ValueError: It is none.
    """
    text = request.query_params.get(key, "")
    if not text.isdecimal() or len(text) > 9:
        raise ValueError(f"{key} is {text[:20]!r}; expected a whole number. Reload the page.")
    return int(text)


def videos_of(folder: Path) -> Iterable[Path]:
    """Videos that `hand-recon predict` wrote to a folder and that browsers play, the best first.

    Args:
        folder: The folder of results.
    """
    return (folder / name for name in ("video.webm", "video.mp4") if (folder / name).is_file())
