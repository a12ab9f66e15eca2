"""Every command that a document shows is understood, and those that need nothing but the checkout run."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.shown_commands import compose_command, shown_commands

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*(ROOT / "docs").glob("*.md"), ROOT / "data" / "README.md", ROOT / "CONTRIBUTING.md"]
SHOWN = sorted({(path, command) for path in DOCUMENTS for command in shown_commands(path)})

RUN = (
    "hand-recon doctor",
    "hand-recon fit examples/hands.json --output outputs/fitted",
)
"""Commands of the documents that need neither a network nor files of the reader's."""


@pytest.mark.parametrize(
    ("document", "command"), SHOWN, ids=[f"{path.stem}: {command}" for path, command in SHOWN]
)
def test_every_command_of_the_documents_composes(document: Path, command: str) -> None:
    assert document.is_file()
    compose_command(command)


@pytest.mark.slow
@pytest.mark.parametrize("command", RUN)
def test_commands_that_need_nothing_run_as_they_stand(command: str, tmp_path: Path) -> None:
    assert any(command in path.read_text() for path in DOCUMENTS)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    words = [sys.executable, "-m", "hand_recon", *command.split()[1:]]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
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
        "../data/README", "../README", "../CONTRIBUTING", "../CHANGELOG", "decisions/README"
    }  # fmt: skip
