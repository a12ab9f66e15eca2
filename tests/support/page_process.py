"""Work of a process that is not the page's own, so that the process starts without the networks."""

import os
import time
from collections.abc import Mapping
from typing import Any


def load(content: Mapping[str, Any]) -> None:
    """Preparation of a process; what it was given stays in its environment."""
    os.environ["GIVEN"] = str(content["number"])


def perform(method: str, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Work of a process: methods for tests in the place of those of `HandService`."""
    if method == "sleep":
        time.sleep(arguments[0])
    if method == "crash":
        os._exit(1)
    if method == "fail":
        raise ValueError("The file is damaged.")
    return os.getpid(), os.environ["GIVEN"], arguments, dict(named)
