"""A network in TensorFlow Lite's format, run by LiteRT on the CPU."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

MISSING = (
    "Finding hands in images needs LiteRT, which is not installed: pip install 'hand_recon[detect]', or "
    "pip install ai-edge-litert. Without it, give landmarks (detector=landmarks)."
)


class Network:
    """A network with one image as input; the model is read and compiled at the first image.

    Not for several threads at once: each needs its own.
    """

    def __init__(self, model: Callable[[], bytes], threads: int = 1) -> None:
        """Store how the model is had.

        Args:
            model: Function that returns the file's content.
            threads: Number of threads.

        Raises:
            ValueError: The number of threads is not positive.
        """
        if threads < 1:
            raise ValueError(f"Expected detector.threads of at least 1, found {threads}.")
        self.model = model
        self.threads = threads

    @cached_property
    def interpreter(self) -> Any:  # noqa: ANN401  # LiteRT ships no types
        """LiteRT's interpreter, ready to run.

        Raises:
            ModuleNotFoundError: LiteRT is not installed.
        """
        try:
            from ai_edge_litert.interpreter import Interpreter
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(MISSING, name=error.name) from error
        content = self.model()
        with _without_notes():
            interpreter = Interpreter(model_content=content, num_threads=self.threads)
            interpreter.allocate_tensors()
        return interpreter

    @property
    def input_size(self) -> int:
        """Side of the input, pixels."""
        return int(self.interpreter.get_input_details()[0]["shape"][1])

    def __call__(
        self, crop: UInt8[np.ndarray, "size size 3"]
    ) -> tuple[Float[np.ndarray, "..."], ...]:
        """Run the network on an RGB crop, scaled to the range 0 to 1.

        Returns:
            Copies of the outputs in the model's order, without the axis of the batch.
        """
        interpreter = self.interpreter
        scaled = crop[None].astype(np.float32) / np.float32(255)
        interpreter.set_tensor(interpreter.get_input_details()[0]["index"], scaled)
        interpreter.invoke()
        details = interpreter.get_output_details()
        return tuple(interpreter.get_tensor(one["index"])[0] for one in details)


@contextmanager
def _without_notes() -> Iterator[None]:
    """Hold back the notes (`INFO: …`) that LiteRT's C++ code writes to the error stream; pass on the rest."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as written:
        os.dup2(written.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            written.seek(0)
            for line in written:
                if not line.startswith(b"INFO:"):
                    os.write(2, line)
