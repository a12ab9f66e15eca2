"""Members of sweeps whose processes are small scripts in the place of trainings."""

import json
import sys
from pathlib import Path

import pytest

from hand_recon.command_line.member import Call
from hand_recon.sweeps.attempts import Member


def member(folder: Path, name: str, *overrides: str, verb: str = "train") -> Member:
    """A member whose settings are its overrides."""
    return Member(verb, verb, overrides, folder / name, {"overrides": list(overrides)}, name)


def scripts(monkeypatch: pytest.MonkeyPatch, source: str) -> None:
    """Let every member run a script: `words` are its overrides, `folder` is its folder.

    Args:
        monkeypatch: Of the test.
        source: Python, after imports of json, os, sys and Path.
    """

    def words(call: Call) -> list[str]:
        beginning = (
            "import json, os, sys\nfrom pathlib import Path\ncall = json.loads(sys.argv[1])\n"
        )
        beginning += "words = call['overrides']\nfolder = Path(call['error']).parent\n"
        content = {"overrides": call.overrides, "error": call.error, "cores": call.cores}
        return [sys.executable, "-S", "-c", beginning + source, json.dumps(content)]

    monkeypatch.setattr(Call, "words", words)


def finished_run(folder: Path) -> Path:
    """Make a folder of a finished training, as far as a sweep looks at it."""
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text("{}")
    (folder / "config.yaml").write_text("seed: 0\n")
    return folder
