"""The webcam's connection: an image comes, its hands go back, and only then does the page send the next."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from starlette.websockets import WebSocket, WebSocketDisconnect

from hand_recon.page.bounds import Bounds
from hand_recon.page.worker import BusyError, TookTooLongError, Worker, WorkerEndedError


@dataclass
class _Use:
    """The connection that has the webcam's place; None if it is free."""

    owner: WebSocket | None = field(default=None)


def webcam(worker: Worker, bounds: Bounds) -> Callable[[WebSocket], Awaitable[None]]:
    """Endpoint of the webcam, for one page at a time.

    Args:
        worker: Finds and fits the hands.
        bounds: Most bytes of an image.
    """
    use = _Use()

    async def endpoint(socket: WebSocket) -> None:
        await socket.accept()
        if use.owner is not None:
            await socket.send_json(
                {"error": "Another page uses its camera; expected one at a time. Stop it there."}
            )
            await socket.close(code=1013)
            return
        use.owner = socket
        try:
            await _answer(socket, worker, bounds)
        except WebSocketDisconnect:
            pass
        finally:
            use.owner = None

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
        except (ValueError, BusyError) as error:
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
