"""The folder that Hydra makes for a run, refused with a message where it cannot be made."""

import sys
from pathlib import Path
from typing import Any, Final

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from hand_recon.command_line.user_errors import reason_of

OVERRIDE: Final = f"++hydra.callbacks.run_folder._target_={__name__}.RunFolder"
"""Override that lets Hydra use `RunFolder`; a run of a sweep has it from the sweep, and again."""


class RunFolder(Callback):
    """Makes the folder of a run before Hydra does, whose own attempt would end in a traceback."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401  # Hydra's
        """Make a run's folder."""
        _make(config.hydra.run.dir)

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401  # Hydra's
        """Make a sweep's folder."""
        _make(config.hydra.sweep.dir)


def _make(folder: str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        sys.stderr.write(f"error: {reason_of(error)}\n")
        raise SystemExit(1) from error
