"""The detector's models for tests: the published ones if they can be had, and made-up ones."""

import hashlib
import os
from functools import cache
from pathlib import Path

import pytest

from hand_recon.detection import model_files, models
from hand_recon.detection.model_download import prepare_models
from hand_recon.detection.models import Model, ModelFolder, ModelsError

OWN_CACHE = Path(__file__).parents[2] / ".cache" / "hand_recon" / "detector"
"""Folder of the published models in a checkout, unless $HAND_RECON_CACHE names another cache."""


@cache
def _published() -> tuple[Path, str]:
    folder = ModelFolder(None if os.environ.get("HAND_RECON_CACHE") else OWN_CACHE)
    try:
        prepare_models((), folder)
    except (ModelsError, OSError) as error:
        return folder.path, str(error)
    return folder.path, ""


def published_models() -> Path:
    """Folder of the published models, fetched once; skips the test with the reason if they cannot be had."""
    pytest.importorskip("ai_edge_litert", reason="LiteRT (the extra detect) is not installed")
    folder, trouble = _published()
    if trouble:
        pytest.skip(trouble)
    return folder


def made_up_models(monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Two short files in place of the published models.

    Returns:
        Content by the name of the file in the cache.
    """
    contents = {"palms.tflite": b"palms" * 300, "landmarks.tflite": b"landmarks" * 400}
    made_up = tuple(
        Model(name, len(content), hashlib.sha256(content).hexdigest(), f"bundled_{name}")
        for name, content in contents.items()
    )
    monkeypatch.setattr(models, "MODELS", made_up)
    monkeypatch.setattr(model_files, "MODELS", made_up)
    return contents
