"""Checkpoints call nothing that is not trusted, and a user's own parts train, test and load."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from hand_recon.command_line.user_errors import reason_of
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


HELD: dict[str, Any] = {"a": 1}
HELD["itself"] = HELD


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"hand": {}, "model": {}, "prior": None}, "prior: null in its configuration; expected the group"),
        ({"hand": {}, "model": 3}, "model: 3 in its configuration; expected the group of settings"),
        ({"hand": {}, "model": {}, "prior": "y"}, "prior: 'y' in its configuration; expected the"),
        ({"model": {}}, "hand: null in its configuration"),
        ({"hand": {}, "model": {"encoder": {}}, "prior": {"range_of_motion": "x"}}, "cannot be rebuilt"),
        ({"a": torch.zeros(1)}, r"has a configuration that is none \("),
        (HELD, "50 levels or 100,000 values, or one that holds itself"),
    ],
)  # fmt: skip
def test_a_configuration_that_is_none_is_refused_by_name(
    tmp_path: Path, config: dict[str, Any], message: str
) -> None:
    torch.save({CONFIG_KEY: config}, tmp_path / "a.ckpt")
    with pytest.raises(ValueError, match=rf"a\.ckpt .*{message}"):
        load_trained(tmp_path / "a.ckpt")


def _with_pickle(file: Path, content: bytes, method: int = zipfile.ZIP_STORED) -> None:
    """Write a checkpoint with a pickle made by hand."""
    torch.save({}, file)
    with zipfile.ZipFile(file) as archive:
        members = {one.filename: archive.read(one) for one in archive.infolist()}
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, member in members.items():
            archive.writestr(name, content if name.endswith("data.pkl") else member)


def _configuration(value: bytes) -> bytes:
    """Pickle of a checkpoint whose configuration is a pickled value."""
    key = CONFIG_KEY.encode()
    inner = b"}X\x01\x00\x00\x00a" + value + b"s"
    return b"\x80\x02}X" + len(key).to_bytes(4, "little") + key + inner + b"s."


def test_a_configuration_that_would_never_be_read_to_its_end_is_refused(tmp_path: Path) -> None:
    _with_pickle(tmp_path / "deep.ckpt", _configuration(b"]" * 100_000 + b"a" * 99_999))
    doubled: list[Any] = [1, 1]
    for _ in range(40):
        doubled = [doubled, doubled]
    torch.save({CONFIG_KEY: {"a": doubled}}, tmp_path / "wide.ckpt")
    for name in ("deep", "wide"):
        with pytest.raises(
            ValueError, match=rf"{name}\.ckpt has a configuration of more than 50 levels or 1"
        ):
            read_checkpoint(tmp_path / f"{name}.ckpt")


def test_a_packed_checkpoint_is_told_from_a_damaged_one(tmp_path: Path) -> None:
    _with_pickle(tmp_path / "a.ckpt", _configuration(b"N" * 9999), zipfile.ZIP_DEFLATED)
    with pytest.raises(
        ValueError, match=r"a\.ckpt is packed: it unpacks to .* take the original file"
    ):
        read_checkpoint(tmp_path / "a.ckpt")


@pytest.mark.parametrize(
    "error", [MemoryError(), RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: 12")]
)  # fmt: skip
def test_a_whole_checkpoint_without_memory_for_it_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def load(*words: object, **settings: object) -> None:
        raise error

    torch.save({CONFIG_KEY: {}}, tmp_path / "a.ckpt")
    (tmp_path / "old.ckpt").write_bytes(b"no archive, which may announce any size")
    monkeypatch.setattr("torch.load", load)
    with pytest.raises(MemoryError, match=r"a\.ckpt has [\d,]+ bytes") as found:
        read_checkpoint(tmp_path / "a.ckpt")
    assert reason_of(found.value).startswith("There is not enough memory")
    with pytest.raises(ValueError, match=r"old\.ckpt is no checkpoint, or a damaged one"):
        read_checkpoint(tmp_path / "old.ckpt")
