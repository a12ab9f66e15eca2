"""Every verb has a module, a configuration and help; start-up imports nothing heavy."""

import importlib
import json
import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from hand_recon.__main__ import main, overview
from hand_recon.command_line.configuration_files import CONF
from hand_recon.command_line.verbs import VERBS

HEAVY = (
    "cv2", "lightning", "matplotlib", "numpy", "scipy", "tensorboard", "torch", "torchmetrics", "torchvision",
    "trimesh",
)  # fmt: skip
"""Packages that take a tenth of a second to seconds to import."""

SLOW_FOR_FIT = (
    "lightning", "torchmetrics", "torchvision", "torch._dynamo", "torch._inductor", "matplotlib",
    "tensorboard",
)  # fmt: skip
"""Packages that fitting hands does not need; torch itself takes most of its start-up."""


def imported(arguments: list[str], folder: Path) -> set[str]:
    """Modules that a process has imported when a command ends."""
    script = (
        "import atexit, json, runpy, sys\n"
        "atexit.register(lambda: json.dump(sorted(sys.modules), open(sys.argv_modules, 'w')))\n"
        f"sys.argv_modules = {str(folder / 'modules.json')!r}\n"
        f"sys.argv = ['hand-recon', *{arguments!r}]\n"
        "runpy.run_module('hand_recon', run_name='__main__')\n"
    )
    done = subprocess.run(  # noqa: S603  # our own interpreter and words
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (folder / "printed.txt").write_text(done.stdout)
    return set(json.loads((folder / "modules.json").read_text()))


def test_every_verb_has_a_configuration_and_a_line_of_help() -> None:
    for verb in VERBS.values():
        assert (Path(CONF) / f"{verb.name}.yaml").is_file(), verb.name
        assert verb.name in overview()
        assert verb.purpose in overview()


def test_the_console_script_is_the_front_door() -> None:
    (script,) = [one for one in entry_points(group="console_scripts") if one.name == "hand-recon"]
    assert script.load() is main


@pytest.mark.parametrize("verb", VERBS)
def test_help_says_what_the_verb_does_and_imports_nothing_heavy(verb: str, tmp_path: Path) -> None:
    modules = imported([verb, "--help"], tmp_path)
    assert modules.isdisjoint(HEAVY)
    printed = (tmp_path / "printed.txt").read_text()
    described = importlib.import_module(f"hand_recon.{verb}").__doc__
    assert described is not None
    assert described.strip() in printed
    # Hydra's own help follows.
    assert f"{verb} is powered by Hydra" in printed


def test_the_overview_needs_not_even_hydra(tmp_path: Path) -> None:
    modules = imported(["--help"], tmp_path)
    assert modules.isdisjoint({*HEAVY, "hydra", "omegaconf"})


def test_doctor_imports_no_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Where an accelerator may be, torch is asked about it.
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert imported(["doctor"], tmp_path).isdisjoint({*HEAVY} - {"numpy"})


def test_a_fit_imports_no_training(tmp_path: Path) -> None:
    hand = [[float(100 + 5 * k), float(100 + 7 * (k % 4))] for k in range(21)]
    (tmp_path / "hands.json").write_text(json.dumps([hand]))
    modules = imported(
        ["fit", "hands.json", "--output", "out", "descent.steps=2", "results.pictures=1"], tmp_path
    )
    assert modules.isdisjoint(SLOW_FOR_FIT)
    assert (tmp_path / "out" / "hands.json").is_file()


def test_commands_make_idle_threads_sleep_before_torch_is_loaded(tmp_path: Path) -> None:
    script = (
        "import os, sys\nimport hand_recon\nassert 'OMP_WAIT_POLICY' not in os.environ\n"
        "from hand_recon.doctor import main\nmain(['--help'])\n"
        "assert os.environ['OMP_WAIT_POLICY'] == 'PASSIVE' and 'torch' not in sys.modules\n"
    )
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    done = subprocess.run(  # noqa: S603  # our own interpreter and words
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_an_unknown_verb_is_refused_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["rtain"])
    assert refused.value.code == 2
    assert "Unknown verb 'rtain'; did you mean train?" in capsys.readouterr().err


def test_an_unknown_nested_option_is_refused_with_the_nearest(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["train", "trainer.max_epoch=3"])
    assert refused.value.code == 2
    assert "did you mean trainer.max_epochs?" in capsys.readouterr().err
