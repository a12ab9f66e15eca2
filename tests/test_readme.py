"""README's Python runs, and every command that it shows is understood."""

import re
from pathlib import Path

import pytest

from hand_recon.command_line.verbs import VERBS
from tests.support.shown_commands import compose_command, shown_commands

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS = shown_commands(ROOT / "README.md")


def test_the_python_of_the_readme_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(block.strip().splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    exec(compile(block, "README.md", "exec"), {})  # noqa: S102  # our own words
    assert "(2, 21, 3) (2, 778, 3)" in capsys.readouterr().out
    assert (tmp_path / "hands.png").is_file()
    assert (tmp_path / "hands.obj").is_file()


def test_the_readme_shows_every_verb() -> None:
    assert {command.split()[0] for command in COMMANDS} == set(VERBS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_readme_composes(command: str) -> None:
    compose_command(command)


def test_the_first_command_comes_early() -> None:
    """Whoever opens the page types something within a minute."""
    before = README[: README.index("    make example")]
    assert len(before.split()) < 120
