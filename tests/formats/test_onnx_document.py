"""The document about ONNX files: its example runs, and its tables name every input and output."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.formats.onnx_graphs import INPUTS, OUTPUTS
from tests.support.onnx_sessions import LifterFile

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "onnx.md").read_text()


def test_the_tables_name_every_input_and_output() -> None:
    named = re.findall(r"^\| `(\w+)` \|", DOCUMENT, re.MULTILINE)
    assert sorted(named) == sorted([*INPUTS, *OUTPUTS])


@pytest.mark.slow
def test_the_example_finds_the_six_hands_where_they_are_in_the_image(
    lifter_file: LifterFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
    assert example.count("\n") <= 27
    assert re.findall(r"^(?:import|from) (\w+)", example, re.MULTILINE) == [
        "json", "pathlib", "numpy", "onnxruntime",
    ]  # fmt: skip
    (tmp_path / "examples").mkdir()
    shutil.copy(ROOT / "examples" / "hands.json", tmp_path / "examples")
    (tmp_path / "lifter.onnx").write_bytes(lifter_file.content)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(example, "docs/onnx.md", "exec"), names)  # noqa: S102  # the document's own code
    assert names["given"].sum() == 6 * 21 - 4
    assert names["left"].tolist() == [False, False, True, False, False, True]
    # Mirrored back, left hands too are where the camera sees them.
    metres, focal = names["metres"], 1.2 * 640
    projected = focal * metres[..., :2] / metres[..., 2:] + np.array([320, 240])
    assert np.abs(projected - names["pixels"]).max() < 0.05
    assert (metres[..., 2] > 0).all()
