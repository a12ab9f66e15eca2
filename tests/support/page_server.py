"""The page's server for tests: its work done in this process, with the landmarks of a file as detector."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from hand_recon.command_line.composing import composed
from hand_recon.page.hand_service import HandService


def demo_config(*overrides: str) -> DictConfig:
    """`conf/demo.yaml` composed, without Hydra's part."""
    return composed("demo", overrides)


def service_of(folder: Path, *overrides: str) -> HandService:
    """The page's work for the photographs of `photo_folder`, without MediaPipe's networks."""
    return HandService(
        demo_config(
            "detector=landmarks",
            f"detector.landmarks='{folder}/found.json'",
            f"camera='{folder}/K.json'",
            *overrides,
        )
    )


@dataclass
class DirectWorker:
    """Calls the methods of an object in this process, and remembers which."""

    service: Any
    """The object."""
    calls: list[str] = field(default_factory=list)
    """Names of the methods that were called."""
    before: Callable[[str], None] = lambda _: None
    """Called with the name of each method before it; may raise what a process would."""
    is_closed: bool = False

    async def call(self, method: str, *arguments: Any, **named: Any) -> Any:  # noqa: ANN401
        """Call a method, as `hand_recon.page.worker.Worker` has it."""
        self.calls.append(method)
        self.before(method)
        return getattr(self.service, method)(*arguments, **named)

    async def close(self) -> None:
        """Remember that it was ended."""
        self.is_closed = True
