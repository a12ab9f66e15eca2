"""Every command that a document shows is understood, and those that a reader's files suffice for run."""

import re
from pathlib import Path

import pytest

from tests.support.detector_models import published_models
from tests.support.readers_folder import run_command, write_readers_folder
from tests.support.shown_commands import compose_command, shown_commands

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*(ROOT / "docs").glob("*.md"), ROOT / "data" / "README.md", ROOT / "CONTRIBUTING.md"]
EVERY = {command for path in [*DOCUMENTS, ROOT / "README.md"] for command in shown_commands(path)}
SHOWN = sorted({(path, command) for path in DOCUMENTS for command in shown_commands(path)})

RUN = (
    "doctor",
    "fit examples/hands.json --output outputs/fitted",
    "fit landmarks.json intrinsics=K.json --output outputs/with_camera",
    "audit hands.json",
    "audit poses/ same_person=true repair=true --output outputs/poses",
    "audit poses.npy repair=true",
    "export hands.json",
    "export hands.json format=glb,bvh,openxr --output my_files",
    "export outputs/my_hands/hands.json format=glb,bvh,openxr",
    "export default format=onnx --output lifter.onnx",
)
"""Commands of the documents that run with a reader's files, and no network."""

RUN_WITH_DETECTOR = (
    "predict examples/hand.jpg examples/two_hands.jpg --output outputs/first_hands",
    "predict photos --output outputs/photos camera=fov=60 results.meshes=glb",
    "predict photo.jpg camera=fov=60 results.meshes=glb",
    "predict photos rank=uncertainty",
    "predict clip.mp4 --output outputs/clip",
    "predict frames motion.fps=25",
    "prepare labels my_photos output=my_labels",
)
"""Commands that need the detector's networks, too."""


@pytest.mark.parametrize(
    ("document", "command"), SHOWN, ids=[f"{path.stem}: {command}" for path, command in SHOWN]
)
def test_every_command_of_the_documents_composes(document: Path, command: str) -> None:
    assert document.is_file()
    compose_command(command)


@pytest.fixture(scope="module")
def readers_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_readers_folder(tmp_path_factory.mktemp("reader") / "files")


@pytest.mark.slow
@pytest.mark.parametrize("command", RUN)
def test_commands_run_as_the_documents_show_them(command: str, readers_folder: Path) -> None:
    assert command in EVERY
    done = run_command(command, readers_folder)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", RUN_WITH_DETECTOR)
def test_commands_on_photographs_run_as_the_documents_show_them(
    command: str, readers_folder: Path
) -> None:
    assert command in EVERY
    done = run_command(f"{command} detector.models={published_models()}", readers_folder)
    assert done.returncode == 0, done.stderr


def test_every_document_is_in_the_menu_of_the_site() -> None:
    menu = (ROOT / "docs" / "index.md").read_text()
    entries = {
        line.rpartition("<")[2].strip("<>")
        for block in re.findall(r"```\{toctree\}\n(.*?)```", menu, re.DOTALL)
        for line in block.splitlines()
        if line and not line.startswith(":")
    }
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert entries == pages | {
        "../data/README", "../README", "../CONTRIBUTING", "../SECURITY", "../CHANGELOG", "decisions/README",
    }  # fmt: skip
