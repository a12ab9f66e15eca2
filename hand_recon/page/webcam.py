"""The webcam's connection: an image comes, its hands go back, and only then does the page send the next."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from hand_recon.page.bounds import Bounds
from hand_recon.page.worker import BusyError, TookTooLongError, Worker, WorkerEndedError

WAIT: Final = 3.0
"""Time for the connection before to end, seconds: a page's own, whose last image is still worked on."""


def webcam(
    worker: Worker, bounds: Bounds, wait: float = WAIT
) -> Callable[[WebSocket], Awaitable[None]]:
    """Endpoint of the webcam, for one page at a time.

    Args:
        worker: Finds and fits the hands.
        bounds: Most bytes of an image.
        wait: Time for the connection before to end, seconds.
    """
    place = asyncio.Lock()

    async def endpoint(socket: WebSocket) -> None:
        await socket.accept()
        with contextlib.suppress(WebSocketDisconnect):
            try:
                async with asyncio.timeout(wait):
                    await place.acquire()
            except TimeoutError:
                await socket.send_json(
                    {
                        "error": "Another page uses its camera; expected one at a time. Stop it there."
                    }
                )
                await socket.close(code=1013)
                return
            try:
                await _answer(socket, worker, bounds)
            finally:
                place.release()

    return endpoint


async def _answer(socket: WebSocket, worker: Worker, bounds: Bounds) -> None:
    """Answer image by image until the page leaves."""
    is_first = True
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        # A text is no image, and no bytes are refused as such.
        content: bytes = message.get("bytes") or b""
        if len(content) > bounds.frame_bytes:
            await socket.send_json(
                {
                    "error": f"The webcam's image has {len(content)} bytes; expected at most "
                    f"{bounds.frame_bytes}. Send a smaller one."
                }
            )
            continue
        try:
            found = await worker.call("live", content, is_first=is_first)
            is_first = False
        except (ValueError, OSError, BusyError) as error:
            # OSError: the detector's models cannot be fetched; its text says what to do.
            found = {"error": str(error)}
        except (TookTooLongError, WorkerEndedError) as error:
            # The new process knows nothing of the hands that were followed.
            found, is_first = {"error": str(error)}, True
        except Exception as error:  # noqa: BLE001  # one image never ends the connection without a word
            found = {
                "error": f"The webcam's image could not be worked on ({type(error).__name__}: "
                f"{str(error)[:200]}). Start the webcam again; please report this if it comes again."
            }
            is_first = True
        await socket.send_json(found)
