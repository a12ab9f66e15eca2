"""Several pages at once: memory is bounded, pages open, and no page is given results of another file."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest

from hand_recon.page.bounds import Bounds
from hand_recon.page.kept_results import ForgottenError, KeptResult, KeptResults
from hand_recon.page.routes import PageSettings, page_app
from hand_recon.page.worker import BusyError
from tests.support.page_server import DirectWorker

HERE = "http://127.0.0.1:8765"


class Told:
    """Answers every file with its name."""

    def about(self) -> dict[str, Any]:
        return {"model": "any"}

    def file(self, name: str, content: bytes) -> dict[str, Any]:
        return {"name": name, "bytes": len(content)}


def test_no_more_files_are_read_at_once_than_may_wait() -> None:
    """Files that are still being sent take memory, too."""
    app = page_app(DirectWorker(Told()), PageSettings(bounds=Bounds(waiting=1)))

    async def main() -> None:
        sent, more = asyncio.Semaphore(0), asyncio.Event()

        async def slow() -> AsyncIterator[bytes]:
            yield b"12"
            sent.release()
            await more.wait()

        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=HERE) as client:
            first = [
                asyncio.create_task(client.post("/api/file", content=slow())) for _ in range(2)
            ]
            for _ in first:
                await sent.acquire()
            refused = await client.post("/api/file", content=b"123")
            assert refused.status_code == 503
            assert refused.json()["error"].startswith("2 files are being sent or worked on")
            more.set()
            assert [(await one).json()["bytes"] for one in first] == [2, 2]
            assert (await client.post("/api/file", content=b"123")).json()["bytes"] == 3

    asyncio.run(main())


def test_the_page_opens_while_other_files_are_worked_on() -> None:
    worker = DirectWorker(Told())
    app = page_app(worker, PageSettings())

    def busy(method: str) -> None:
        raise BusyError("5 files wait.")

    async def main() -> None:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=HERE) as client:
            first = (await client.get("/api/about")).json()
            worker.before = busy
            assert (await client.get("/api/about")).json() == first
            assert (await client.post("/api/file", content=b"")).status_code == 503

    asyncio.run(main())


def test_a_result_of_an_ended_process_is_never_one_of_the_next() -> None:
    before, after = KeptResults(), KeptResults()
    numbers = [before.add(KeptResult("a.jpg", {})) for _ in range(3)]
    after.add(KeptResult("b.jpg", {}))
    assert before[numbers[2]].name == "a.jpg"
    for number in numbers:
        with pytest.raises(ForgottenError, match=r"is not kept any more"):
            after[number]
    # Numbers stay whole in JavaScript.
    assert max(numbers) < 2**53
