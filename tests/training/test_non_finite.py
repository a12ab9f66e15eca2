"""A loss that is no number ends the training, at once or a step later, and its weights are not saved."""

from dataclasses import replace
from pathlib import Path

import lightning
import pytest
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from hand_recon.schema import HandBatch
from hand_recon.training import non_finite
from hand_recon.training.module import HandReconstruction
from hand_recon.training.non_finite import Arriving, LossGuard, NonFiniteLossError
from tests.support.resident_hands import module_of, resident
from tests.support.small_runs import BARE_TRAINER_WARNINGS

pytestmark = BARE_TRAINER_WARNINGS


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> None:
    """Losses are checked a step later, as on a GPU."""
    monkeypatch.setattr(non_finite, "is_late", lambda loss: True)


def batches(count: int, broken: int) -> list[HandBatch]:
    """Batches with floats as images, of which one has a label that is infinite."""
    hands = resident(module_of(1).regressor.hand, 2)
    found = []
    for number in range(count):
        batch = hands.batch(torch.arange(2))
        labels = batch.landmarks_2d.clone()
        if number == broken:
            labels[0, 3] = torch.inf
        names = (f"{number}/a", f"{number}/b")
        found.append(replace(batch, image=batch.image / 255, landmarks_2d=labels, source=names))
    return found


def losses(value: float) -> dict[str, Tensor]:
    return {"loss": torch.tensor(value), "data": torch.tensor(1.0)}


@pytest.mark.usefixtures("late")
def test_a_loss_of_a_gpu_is_refused_a_step_later_with_its_own_batch() -> None:
    guard, hands = LossGuard(), batches(3, 9)
    guard.watch(losses(1.0), hands[0], 7)
    guard.watch(losses(torch.nan), hands[1], 8)
    with pytest.raises(NonFiniteLossError, match=r"at step 8: .*'loss': nan.*'1/a'") as refused:
        guard.watch(losses(1.0), hands[2], 9)
    assert (refused.value.batch, refused.value.step) == (hands[1], 8)
    assert refused.value.losses["data"] == 1.0
    guard.settle()  # Once is enough.


def test_a_loss_of_a_processor_is_refused_at_once() -> None:
    with pytest.raises(NonFiniteLossError, match="at step 3"):
        LossGuard().watch(losses(torch.inf), batches(1, 9)[0], 3)


def test_an_arriving_value_is_that_of_its_time() -> None:
    value = torch.tensor(True)
    arriving = Arriving(value.clone())
    value.fill_(False)
    assert arriving.read()


def fit(
    module: HandReconstruction,
    given: list[HandBatch],
    folder: Path,
    every: int,
    validation: list[HandBatch] | None = None,
) -> None:
    """Train on batches, saving a checkpoint every few steps; then validate if there are hands for it."""
    saving = lightning.pytorch.callbacks.ModelCheckpoint(
        folder, "{step}", every_n_train_steps=every, save_top_k=-1
    )
    lightning.Trainer(
        max_epochs=1,
        accelerator="cpu",
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[saving],
        num_sanity_val_steps=0,
        limit_val_batches=0 if validation is None else 1.0,
    ).fit(
        module,
        DataLoader(given, batch_size=None),  # type: ignore[arg-type]  # a list will do
        None if validation is None else DataLoader(validation, batch_size=None),  # type: ignore[arg-type]
    )


@pytest.mark.usefixtures("late")
@pytest.mark.parametrize(
    ("broken", "saved"), [(1, ["step=1.ckpt"]), (2, ["step=1.ckpt", "step=2.ckpt"])]
)
def test_no_checkpoint_has_weights_that_such_a_loss_changed(
    tmp_path: Path, broken: int, saved: list[str]
) -> None:
    """The last step's loss is checked at the end of the epoch, another's when its weights are to be saved."""
    with pytest.raises(NonFiniteLossError, match=f"'{broken}/a'"):
        fit(module_of(1), batches(3, broken), tmp_path, every=1)
    assert sorted(path.name for path in tmp_path.iterdir()) == saved
    for path in tmp_path.iterdir():
        weights = torch.load(path, weights_only=False)["state_dict"].values()
        assert all(torch.isfinite(one).all() for one in weights)


@pytest.mark.usefixtures("late")
def test_weights_that_the_last_loss_changed_are_not_scored(tmp_path: Path) -> None:
    """The scores of weights that are no numbers would be another error, about hands that are right."""
    with pytest.raises(NonFiniteLossError, match="'2/a'"):
        fit(module_of(1), batches(3, 2), tmp_path, every=9, validation=batches(1, 9))
