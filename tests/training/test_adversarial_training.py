"""Training with a discriminator: its steps, its checkpoints, and errors about missing data."""

import copy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import lightning
import pytest
import torch

from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.synthetic.datamodule import SyntheticDataModule
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.runs.building import build_data, build_module
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.training_run import train
from hand_recon.training.module import HandReconstruction
from tests.support.configurations import settings
from tests.support.small_runs import LIGHTNING_WARNINGS

pytestmark = LIGHTNING_WARNINGS

SMALL = (
    "recipe=lifter", "prior=adversarial", "data_term=mse", "synthetic.train=32", "synthetic.val=8",
    "synthetic.test=8", "data.render_workers=1", "data.batch_size=16", "model.width=32",
    "model.encoder.width=32", "model.encoder.depth=1", "model.encoder.landmark_dropout=0.0",
    "optimizer.schedule=null",
    "trainer.max_epochs=2", "trainer.check_val_every_n_epoch=1", "trainer.accelerator=cpu",
    "report.images=0",
)  # fmt: skip


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def run(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    train(settings(cache, folder, *SMALL))
    return folder


def last(folder: Path) -> dict[str, Any]:
    path = folder / "checkpoints" / "last.ckpt"
    return dict(torch.load(path, weights_only=True)["state_dict"])


def discriminator_weights(state: dict[str, Any]) -> dict[str, torch.Tensor]:
    return {name: value for name, value in state.items() if "adversary.discriminator" in name}


def test_a_run_trains_the_discriminator_once_per_step_and_its_checkpoint_loads(run: Path) -> None:
    """Two epochs of two batches are four steps."""
    assert last(run)["prior.terms.adversarial.adversary._extra_state"]["steps"] == 4
    module = load_trained(run).module
    for name, value in discriminator_weights(module.state_dict()).items():
        assert torch.equal(value, torch.load(
            run / "checkpoints" / "best.ckpt", weights_only=True
        )["state_dict"][name])  # fmt: skip
    log = (run / "csv" / "metrics.csv").read_text().splitlines()[0]
    assert {"train/adversarial", "train/weighted/adversarial", "train/discriminator"} <= set(
        log.split(",")
    )


def test_a_run_that_is_continued_has_the_discriminator_of_one_that_was_not(
    run: Path, cache: Path, tmp_path: Path
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    train(settings(cache, first, *SMALL, "trainer.max_epochs=1"))
    train(settings(cache, second, *SMALL, f"resume={first}"))
    whole, continued, half = (
        discriminator_weights(last(folder)) for folder in (run, second, first)
    )
    for name, value in whole.items():
        torch.testing.assert_close(continued[name], value, rtol=1e-3, atol=1e-5)
        assert not torch.equal(half[name], value)


def test_the_networks_optimizer_never_holds_the_discriminators_weights(
    run: Path, cache: Path
) -> None:
    module = build_module(settings(cache, run, *SMALL))
    adversary = module.adversary
    assert adversary is not None
    module._trainer = None
    optimizer = module.configure_optimizers()
    assert isinstance(optimizer, torch.optim.Optimizer)
    held = {id(weight) for group in optimizer.param_groups for weight in group["params"]}
    assert held == {id(weight) for weight in module.regressor.parameters()}
    assert not held & {id(weight) for weight in adversary.parameters()}


def test_the_networks_loss_reaches_its_own_weights_and_not_the_discriminators(
    cache: Path, tmp_path: Path
) -> None:
    config = settings(cache, tmp_path, *SMALL)
    module, data = build_module(config), build_data(config)
    adversary = module.adversary
    real = data.train_parameters()
    assert adversary is not None
    assert real is not None
    adversary.set_real_hands(real)
    batch = next(iter(data.val_dataloader()))
    loss = module.losses(batch, module(batch))["weighted/adversarial"]
    loss.backward()
    assert all(weight.grad is None for weight in adversary.parameters())
    gradients = [weight.grad for weight in module.regressor.parameters()]
    assert sum(float(one.abs().sum()) for one in gradients if one is not None) > 0


def test_the_best_checkpoint_is_not_chosen_by_a_discriminator_that_changes(
    cache: Path, tmp_path: Path
) -> None:
    config = settings(cache, tmp_path, *SMALL)
    module, data = build_module(config), build_data(config)
    real = data.train_parameters()
    assert module.adversary is not None
    assert real is not None
    module.adversary.set_real_hands(real)
    module.validation_step(next(iter(data.val_dataloader())), 0)
    seen = module._validation_losses.means()
    assert seen["adversarial"] > 0
    torch.testing.assert_close(
        seen["selection"], seen["data"] + seen["weighted/shape"], rtol=1e-5, atol=1e-3
    )


class Without(HandDataModule):
    """Views without known pose and shape."""

    name = "without"


def trainer() -> lightning.Trainer:
    return lightning.Trainer(
        max_steps=1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip


@pytest.fixture
def views(cache: Path) -> Callable[[str], SyntheticHands]:
    return lambda split: SyntheticHands(
        split, 32 if split == "train" else 8, 224, "hard", cache_dir=cache, pictures=False
    )


def test_data_without_pose_and_shape_are_refused_with_the_cure(
    cache: Path, tmp_path: Path, views: Callable[[str], SyntheticHands]
) -> None:
    splits = [partial(views, split) for split in ("train", "val", "test")]
    data = Without(*splits, crop_size=224, batch_size=16)
    assert data.train_parameters(5) is None
    module = build_module(settings(cache, tmp_path, *SMALL))
    with pytest.raises(ValueError, match=r"without has none.*prior\.adversarial\.real.*prior=full"):
        trainer().fit(module, datamodule=data)
    module = build_module(settings(cache, tmp_path, *SMALL))
    with pytest.raises(ValueError, match="there is no datamodule"):
        trainer().fit(module, data.train_dataloader(), data.val_dataloader())


def test_the_real_hands_may_be_those_of_other_data(
    cache: Path, tmp_path: Path, views: Callable[[str], SyntheticHands]
) -> None:
    """The training data have no poses; the sixteen real hands are those of prior.adversarial.real."""
    splits = [partial(views, split) for split in ("train", "val", "test")]
    data = Without(*splits, crop_size=224, batch_size=16)
    other = {
        "_target_": "hand_recon.data.synthetic.datamodule.SyntheticDataModule", "level": "hard",
        "train_size": 16, "val_size": 8, "test_size": 8, "crop_size": 224, "cache_dir": str(cache),
        "pictures": False,
    }  # fmt: skip
    config = settings(cache, tmp_path, *SMALL)
    config.prior.adversarial.real = other
    module = build_module(config)
    before = copy.deepcopy(discriminator_weights(module.state_dict()))
    trainer().fit(module, datamodule=data)
    assert module.adversary is not None
    assert module.adversary._real is not None
    assert len(module.adversary._real.shape) == 16
    after = discriminator_weights(module.state_dict())
    assert all(not torch.equal(value, after[name]) for name, value in before.items())


def test_synthetic_hands_know_what_made_their_training_pictures(cache: Path) -> None:
    data = SyntheticDataModule(
        "hard",
        train_size=32,
        val_size=8,
        test_size=8,
        crop_size=224,
        cache_dir=cache,
        pictures=False,
    )
    ground_truth = SyntheticHands("train", 32, 224, "hard", cache_dir=cache, pictures=False)
    some, everything = data.train_parameters(4), data.train_parameters()
    assert torch.equal(everything.joint_angles, ground_truth.parameters(slice(None)).joint_angles)
    assert torch.equal(some.shape, ground_truth.parameters(torch.tensor([0, 8, 16, 24])).shape)


def test_other_priors_pay_nothing_for_it(cache: Path, tmp_path: Path) -> None:
    """No weights, no state, nothing logged, and the data are not asked for 3D."""

    def never(self: HandDataModule, limit: int | None = None) -> None:
        raise AssertionError("Only prior=adversarial may ask for 3D.")

    config = settings(cache, tmp_path, *SMALL, "prior=none")
    module: HandReconstruction = build_module(config)
    assert not any("adversary" in name for name in module.state_dict())
    data = build_data(config)
    data.train_parameters = never.__get__(data)  # type: ignore[method-assign]
    one = trainer()
    one.fit(module, datamodule=data)
    assert not any(
        "discriminator" in name or "adversarial" in name for name in one.callback_metrics
    )
