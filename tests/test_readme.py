"""README's Python runs, and every command that it shows is understood."""

import re
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig

from hand_recon.command_line.configuration_files import CONF, booleans, groups, known_names
from hand_recon.command_line.verbs import VERBS
from hand_recon.command_line.words import to_overrides
from hand_recon.prepare import CONFIGURATIONS

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS = sorted(
    {
        found[1].partition("#")[0].partition(" | ")[0].strip()
        for found in re.finditer(
            r"hand-recon ((?:predict|fit|train|evaluate|score|report|figures|doctor|prepare)\b[^`\n]*)",
            README,
        )
    }
)


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
    verb, *words = (
        command.replace("…", "/nowhere").replace("/nowhere lifter", "h.json lifter").split()
    )
    config = CONFIGURATIONS.get(words[0], verb) if verb == "prepare" else verb
    overrides = to_overrides(
        words, VERBS[verb], known_names(config), booleans=booleans(config), groups=groups(config)
    )
    overrides = [
        word if word.startswith("input=") else word.split(",")[0]
        for word in overrides
        if word != "-m"
    ]
    with initialize_config_dir(CONF, version_base="1.3"):
        HydraConfig.instance().set_config(compose(config, overrides, return_hydra_config=True))


def test_the_first_command_comes_early() -> None:
    """Whoever opens the page types something within a minute."""
    before = README[: README.index("    make example")]
    assert len(before.split()) < 120
