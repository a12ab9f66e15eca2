"""Files behind http and https addresses: whole or a range of bytes, with a bounded number of attempts."""

import hashlib
import importlib
import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from hand_recon.data.shards.index import CURE
from hand_recon.data.shards.manifest import ShardFile

logger = logging.getLogger(__name__)

Result = TypeVar("Result")

CONNECTIONS: Final = 16
"""Requests that one process sends at the same time."""

TIMEOUT: Final = (10.0, 60.0)
"""Longest wait for a connection and for more bytes of an answer, seconds."""

PLAIN: Final = {"Accept-Encoding": "identity"}
"""Header of requests for files as they are."""

_CHUNK: Final = 1 << 20
_FINAL: Final = frozenset({400, 401, 403, 404, 405, 410, 416})
"""Answers that another attempt does not change."""


class RefusedError(ValueError):
    """An answer that another attempt does not change."""


class TransferError(OSError):
    """An answer that is incomplete, has other bytes, or tells of a fault that may pass."""


def is_url(place: str) -> bool:
    """True for an http or https address."""
    return place.startswith(("http://", "https://"))


class Web:
    """Client for the files of shards; each process opens connections of its own."""

    def __init__(self, attempts: int = 5, pause: float = 0.5) -> None:
        """Store the settings.

        Args:
            attempts: Number of attempts for each file or range.
            pause: Seconds before the second attempt; each further pause is twice as long.
        """
        self.attempts = attempts
        self.pause = pause
        self._session: Any = None
        self._owner = -1

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_session": None}

    def content(self, url: str, most: int) -> bytes:
        """A whole file.

        Args:
            url: Its address.
            most: Most bytes that it may have.

        Raises:
            ValueError: It has more bytes, or the server refuses it.
            ConnectionError: All attempts failed.
        """

        def get() -> bytes:
            with self._answer(url, {}) as answer:
                content: bytes = answer.raw.read(most + 1, decode_content=True)
            if len(content) > most:
                raise RefusedError(
                    f"{url} has more than {most:,} bytes; expected a manifest of shards."
                )
            return content

        return self._repeated(url, get)

    def span(self, url: str, offset: int, size: int) -> bytes:
        """A range of bytes of a file.

        Args:
            url: Its address.
            offset: First byte.
            size: Number of bytes.

        Raises:
            ValueError: The server refuses it, or does not serve ranges.
            ConnectionError: All attempts failed.
        """
        wanted = {"Range": f"bytes={offset}-{offset + size - 1}", **PLAIN}

        def get() -> bytes:
            with self._answer(url, wanted) as answer:
                if answer.status_code != 206:
                    raise RefusedError(
                        f"{url}: the server answers with the whole file (status {answer.status_code}) where "
                        "a range of it was asked for. Set data.order=shards, which downloads whole shards."
                    )
                content: bytes = answer.raw.read(size + 1)
            if len(content) != size:
                raise TransferError(f"{len(content)} bytes came, expected {size}")
            return content

        return self._repeated(url, get)

    def download(self, url: str, file: ShardFile, target: Path) -> None:
        """Download a file with a known checksum; it is at its place only if it is whole.

        Args:
            url: Its address.
            file: Size and checksum.
            target: Its place.

        Raises:
            ValueError: The server refuses it.
            ConnectionError: All attempts failed, or gave a file of another size or checksum.
            OSError: It cannot be written, as on a full disk; no other attempt is made.
        """
        unfinished = target.with_name(f"{target.name}.part")

        def get() -> None:
            digest, size = hashlib.sha256(), 0
            with self._answer(url, PLAIN) as answer, unfinished.open("wb") as stream:
                while chunk := answer.raw.read(_CHUNK):
                    size += len(chunk)
                    if size > file.bytes:
                        break
                    digest.update(chunk)
                    stream.write(chunk)
            if size != file.bytes or digest.hexdigest() != file.sha256:
                raise TransferError(
                    f"{size:,} bytes came whose checksum begins with {digest.hexdigest()[:8]}, and the "
                    f"manifest says {file.bytes:,} and {file.sha256[:8]}"
                )
            os.replace(unfinished, target)

        try:
            self._repeated(url, get)
        except BaseException:
            # Room for other files; each attempt begins anew.
            unfinished.unlink(missing_ok=True)
            raise

    def _repeated(self, url: str, get: Callable[[], Result]) -> Result:
        errors = importlib.import_module("requests.exceptions")
        http_errors = importlib.import_module("urllib3.exceptions")
        for attempt in range(1, self.attempts + 1):
            try:
                return get()
            except (TransferError, errors.RequestException, http_errors.HTTPError) as error:
                if attempt == self.attempts:
                    raise ConnectionError(
                        f"{url} could not be read in {attempt} attempts; the last one: {error}. Check the "
                        f"address and the network; if only this file fails: {CURE}"
                    ) from error
                logger.warning("%s: attempt %d failed (%s).", url, attempt, error)
                time.sleep(self.pause * 2 ** (attempt - 1))
        raise ValueError(f"attempts={self.attempts}; expected 1 or more.")

    def _answer(self, url: str, headers: dict[str, str]) -> Any:  # noqa: ANN401  # a response of requests
        answer = self._own_session().get(url, headers=headers, stream=True, timeout=TIMEOUT)
        if answer.status_code in _FINAL:
            answer.close()
            raise RefusedError(
                f"{url}: the server answers {answer.status_code} ({answer.reason}). Check the address and "
                "the right to read it."
            )
        if answer.status_code >= 300:
            answer.close()
            raise TransferError(f"the server answers {answer.status_code} ({answer.reason})")
        return answer

    def _own_session(self) -> Any:  # noqa: ANN401  # a session of requests
        """The session of this process: connections must not be shared after a fork."""
        if self._session is None or self._owner != os.getpid():
            requests = requests_package()
            adapter = requests.adapters.HTTPAdapter(
                pool_connections=CONNECTIONS, pool_maxsize=CONNECTIONS
            )
            session = requests.Session()
            session.mount("http://", adapter)
            session.mount("https://", adapter)
            self._session, self._owner = session, os.getpid()
        return self._session


def requests_package() -> Any:  # noqa: ANN401  # a module
    """The package requests.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    try:
        return importlib.import_module("requests")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "Shards behind a URL need the package requests, which is not installed. Install the extra: "
            "pip install 'hand_recon[shards]', or copy the shards to a local folder."
        ) from error
