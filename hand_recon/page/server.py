"""The page's server: its settings, its address, and the process that works for it."""

import asyncio
import logging
import socket
import webbrowser
from pathlib import Path
from typing import Final

import uvicorn
from omegaconf import DictConfig

from hand_recon.page.bounds import Bounds
from hand_recon.page.guard import LOOPBACK
from hand_recon.page.routes import PageSettings, page_app, videos_of
from hand_recon.page.worker import WorkerProcess

logger = logging.getLogger(__name__)

HANDS_FILES: Final = ("hands.json", "hands.jsonl")
"""Files of hands in a folder of results."""

EXAMPLES: Final = ("examples/hand.jpg", "examples/two_hands.jpg")
"""Photographs of a checkout."""


def serve(config: DictConfig) -> None:
    """Serve the page until Ctrl-C.

    Args:
        config: `conf/demo.yaml` composed.

    Raises:
        FileNotFoundError: There are no results where they should be.
        ValueError: A setting is not as expected, or the networks cannot be loaded.
    """
    settings = page_settings(config)
    bounds = settings.bounds
    worker = WorkerProcess(config, seconds=bounds.seconds, waiting=bounds.waiting)
    app = page_app(worker, settings)
    # Before the networks are loaded, which takes seconds.
    listener = listening(str(config.host), int(config.port))
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            log_level="warning",
            ws="websockets-sansio",
            ws_max_size=2 * bounds.frame_bytes,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
    )
    with listener:
        asyncio.run(_run(server, listener, worker, config))


def listening(host: str, port: int) -> socket.socket:
    """Socket of the server's address.

    Args:
        host: Name or number of the host.
        port: The port.

    Raises:
        ValueError: The address cannot be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise ValueError(
            f"The address {host}, port {port} cannot be used ({error.strerror or error}); expected a free "
            f"one of this machine. End the other page, or add port={min(port + 1, 65535)}."
        ) from error


async def _run(
    server: uvicorn.Server, listener: socket.socket, worker: WorkerProcess, config: DictConfig
) -> None:
    """Load the networks, tell the address, and serve."""
    try:
        logger.info("Loading the networks…")
        await worker.call("about")
        address = shown_address(str(config.host), int(config.port))
        logger.info("Open %s in a browser; Ctrl-C ends it.", address)
        if config.open:
            webbrowser.open(address)
        await server.serve(sockets=[listener])
    finally:
        await worker.close()


def shown_address(host: str, port: int) -> str:
    """Address that a browser of this machine opens the page at.

    Args:
        host: Name or number of the host.
        port: The port.
    """
    # All addresses of the machine are no address of a page, and browsers give them no camera.
    name = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104
    return f"http://[{name}]:{port}/" if ":" in name else f"http://{name}:{port}/"


def page_settings(config: DictConfig) -> PageSettings:
    """Settings of the page, checked.

    Args:
        config: `conf/demo.yaml` composed.

    Raises:
        FileNotFoundError: There are no results where they should be.
        ValueError: A bound or the port is not as expected.
    """
    if not 0 < int(config.port) < 65536:
        raise ValueError(f"port is {config.port}; expected a number from 1 to 65535.")
    host = str(config.host)
    if host not in LOOPBACK:
        logger.warning(
            "host=%s: everybody in this network can open the page and send files, without a password. Leave "
            "host out to have the page on this machine alone.", host,
        )  # fmt: skip
    hands_file = None if config.results is None else results_file(Path(config.results))
    videos = [] if hands_file is None else list(videos_of(hands_file.parent))
    return PageSettings(
        bounds=Bounds.from_config(config.bounds),
        names=(*LOOPBACK, host, *map(str, config.names)),
        hands_file=hands_file,
        video=videos[0] if videos else None,
        examples=tuple(path for path in map(Path, EXAMPLES) if path.is_file()),
    )


def results_file(results: Path) -> Path:
    """File of hands of results.

    Args:
        results: A folder that `hand-recon predict` or `fit` wrote, or a file of hands.

    Raises:
        FileNotFoundError: There is none.
    """
    results = results.expanduser()
    if results.is_file():
        return results
    for name in HANDS_FILES:
        if (results / name).is_file():
            return results / name
    raise FileNotFoundError(
        f"No file of hands at {results}; expected hands.json or hands.jsonl there. Give a folder that "
        "hand-recon predict or fit wrote, or leave it out."
    )
