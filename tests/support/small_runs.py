"""Overrides for a short training run, and the warnings of Lightning that it causes."""

from typing import Final

import pytest

SMALL: Final = (
    "synthetic.train=48", "synthetic.val=16", "synthetic.test=16", "data.render_workers=1",
    "data.batch_size=16", "model.encoder.backbone=mobilenet_v3_small", "model.width=32",
    "trainer.max_epochs=2", "trainer.accelerator=cpu", "threads=1",
    "report.images=3", "crop_size=48",
)  # fmt: skip
"""Two epochs of 48 synthetic hands in crops of 48 px, on one CPU thread."""

BARE_TRAINER_WARNINGS: Final = pytest.mark.filterwarnings(
    # Lightning's own, on Python 3.11 and this torch.
    "ignore:.*treespec:FutureWarning",
    "ignore:.*LeafSpec",
    "ignore:.*does not have many workers",
    "ignore:.*litlogger",
    "ignore:You defined a .validation_step. but have no",
    "ignore:Trying to infer the .batch_size",
)
"""A `pytestmark` for modules that make a trainer of their own: tolerates these warnings and no others."""

LIGHTNING_WARNINGS: Final = pytest.mark.filterwarnings(
    # Lightning's own, on Python 3.11 and this torch.
    "ignore:.*treespec:FutureWarning",
    "ignore:.*LeafSpec",
    "ignore:.*does not have many workers",
    "ignore:.*litlogger",
    # A resumed run writes into a folder of its own.
    "ignore:The dirpath has changed",
)
"""A `pytestmark` for modules that train: tolerates these warnings and no others."""
