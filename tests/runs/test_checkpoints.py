"""Checkpoints call nothing that is not trusted, and a user's own parts train, test and load."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from hand_recon.runs.checkpoints import CONFIG_KEY, VERSION_KEY, load_trained, read_checkpoint
from hand_recon.runs.training_run import train
from tests.support.configurations import settings
from tests.support.small_runs import LIGHTNING_WARNINGS

pytestmark = LIGHTNING_WARNINGS

OWN = "tests.support.own_term.OwnTerm"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two batches with a term of the user's own in its prior, tested to the end."""
    folder = tmp_path_factory.mktemp("own")
    config = settings(
        folder / "cache", folder / "run", "recipe=lifter", "debug=fast_dev_run",
        f"prior.shape._target_={OWN}",
        "synthetic.train=64", "synthetic.val=8", "synthetic.test=8", "model.width=16", "report.images=0",
        "trainer.accelerator=cpu", "data.batch_size=8", "data.render_workers=1",
    )  # fmt: skip
    assert train(config)["test_hands"] == 8
    return folder / "run"


def test_a_part_of_ones_own_is_loaded_when_it_is_trusted(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match=rf"asks to call '{OWN}'.*HAND_RECON_TRUSTED={OWN}"):
        load_trained(run)
    monkeypatch.setenv("HAND_RECON_TRUSTED", OWN)
    assert type(load_trained(run).module.prior.terms["shape"]).__name__ == "OwnTerm"


def changed(run: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """The run's checkpoint with its configuration changed."""
    checkpoint = torch.load(run / "checkpoints" / "best.ckpt", weights_only=True)
    change(checkpoint)
    torch.save(checkpoint, tmp_path / "changed.ckpt")
    return tmp_path / "changed.ckpt"


def test_a_reference_cannot_hide_what_is_called(run: Path, tmp_path: Path) -> None:
    """`${oc.select:…}` reads differently where the key that it names is not there."""

    def hide(checkpoint: dict[str, Any]) -> None:
        config = checkpoint[CONFIG_KEY]
        config["evil"] = {"t": "pathlib.Path.touch"}
        config["data_term"] = {
            "_target_": "${oc.select:evil.t,hand_recon.uncertainty.SquaredError}",
            "self": {"_target_": "pathlib.Path", "_args_": [str(tmp_path / "touched")]},
        }

    with pytest.raises(ValueError, match="references"):
        load_trained(changed(run, tmp_path, hide))
    assert not (tmp_path / "touched").exists()


def test_a_path_of_an_earlier_version_says_which_version_wrote_it(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAND_RECON_TRUSTED", OWN)

    def age(checkpoint: dict[str, Any]) -> None:
        del checkpoint[VERSION_KEY]
        checkpoint[CONFIG_KEY]["model"]["_target_"] = "hand_recon.reconstructor.Reconstructor"

    with pytest.raises(ValueError, match=r"written by hand_recon 0\.1\. Use that version"):
        load_trained(changed(run, tmp_path, age))


@pytest.mark.parametrize(
    "content",
    [
        b"", b"no checkpoint", b"\xff\xd8\xff\xe0 an image", b"PK\x03\x04 cut",
        # Letters that pickles take for instructions: a key, a list's end, a number, a text.
        b"hi\n", b".gitignore", b"G\n", b"U\xdcb\xb7: \x0e\xe7g<\xfe\xcb\x83j",
    ],
)  # fmt: skip
def test_a_file_that_is_no_checkpoint_is_named(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.ckpt"
    file.write_bytes(content)
    with pytest.raises(
        ValueError, match=r"a\.ckpt is no checkpoint, or a damaged one\. Give a run's"
    ):
        read_checkpoint(file)
    torch.save([1.0], file)
    with pytest.raises(ValueError, match=r"a\.ckpt holds a list; expected a checkpoint"):
        read_checkpoint(file)
