"""The detector's models for tests: the published ones if they can be had, and made-up ones."""

import hashlib
import io
import os
import zipfile
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


def zipped(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Content of a zip file.

    Args:
        members: Content by name.
        method: The zip file's way of compressing.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()
