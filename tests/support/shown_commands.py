"""Commands that a document shows, and their composition by Hydra."""

import re
import shlex
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig

from hand_recon.command_line.configuration_files import CONF, booleans, groups, known_names
from hand_recon.command_line.verbs import VERBS
from hand_recon.command_line.words import to_overrides
from hand_recon.prepare import CONFIGURATIONS

_SHOWN = re.compile(
    rf"(?:hand-recon |python -m hand_recon\.)((?:{'|'.join(VERBS)})(?= [^`\n]|\n|`)[^`\n]*)"
)


def shown_commands(document: Path) -> list[str]:
    """Every command that a document shows, in a block or in a sentence, from its verb on.

    Comments and pipes are cut off; placeholders such as `<run>` and `…` are made a path.
    """
    text = document.read_text().replace("\\\n", " ")
    commands = set()
    for found in _SHOWN.finditer(text):
        command = found[1].partition(" #")[0].partition(" | ")[0]
        command = re.sub(r"<[\w ]+>|…", "/nowhere", command)
        commands.add(" ".join(command.split()))
    return sorted(commands)


def compose_command(command: str) -> None:
    """Let Hydra compose the configuration of a command, and raise what it raises.

    Args:
        command: A verb and the words after it, as `shown_commands` gives them.
    """
    verb, *words = shlex.split(command)
    config = CONFIGURATIONS.get(words[0], verb) if verb == "prepare" and words else verb
    overrides = to_overrides(
        words, VERBS[verb], known_names(config), booleans=booleans(config), groups=groups(config)
    )
    singles = [
        word if word.startswith(("input=", "hydra.")) else _first_of_sweep(word)
        for word in overrides
        if word != "-m"
    ]
    with initialize_config_dir(CONF, version_base="1.3"):
        HydraConfig.instance().set_config(compose(config, singles, return_hydra_config=True))


def _first_of_sweep(override: str) -> str:
    """The first of the values that a sweep goes through; a list in brackets is one value."""
    key, equals, value = override.partition("=")
    return override if value.startswith("[") else f"{key}{equals}{value.partition(',')[0]}"
