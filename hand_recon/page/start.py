"""Checks that the page's packages are installed, and starts its server."""

import importlib.util
from typing import Any, Final

from omegaconf import DictConfig

PACKAGES: Final = ("starlette", "uvicorn", "websockets")
"""Packages of the extra `demo`."""


def demo(config: DictConfig) -> dict[str, Any]:
    """Serve the page until Ctrl-C: the function of the verb.

    Args:
        config: `conf/demo.yaml` composed.

    Returns:
        Nothing, since the command has no numbers.

    Raises:
        ModuleNotFoundError: A package of the extra is missing.
        FileNotFoundError: There are no results where they should be.
        ValueError: A setting is not as expected, or the networks cannot be loaded.
    """
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise ModuleNotFoundError(
            f"The page needs {', '.join(missing)}, which is not installed. Install the extra: pip install "
            "'hand_recon[demo]'.",
            name=missing[0],
        )
    from hand_recon.page.server import serve

    serve(config)
    return {}
