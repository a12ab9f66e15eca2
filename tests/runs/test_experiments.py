"""Every experiment composes, and those of Tables 2 and 3 say what the paper says of them (Sec. 4.1, 5)."""

from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

from hand_recon.command_line.configuration_files import CONF
from hand_recon.data.freihand.datamodule import FreiHandDataModule
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.adversarial import AdversarialTerm
from hand_recon.runs.building import build_data
from hand_recon.runs.configuration import build_prior
from hand_recon.tables.conditions import differences
from hand_recon.tables.runs import flattened
from tests.support.configurations import composed
from tests.support.paper_experiments import PAPER_EXPERIMENTS

EXPERIMENTS = sorted((Path(CONF) / "experiment").glob("*.yaml"))


def composed_experiment(experiment: str, *overrides: str) -> DictConfig:
    return composed(f"experiment={experiment}", *overrides)


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_every_experiment_composes_under_its_own_name(path: Path) -> None:
    config = composed_experiment(
        path.stem, *(["data.root=/nowhere"] if path.stem in PAPER_EXPERIMENTS else [])
    )
    assert config.name == path.stem


def test_the_papers_tables_have_an_experiment_for_every_row_that_is_the_papers() -> None:
    assert set(PAPER_EXPERIMENTS) <= {path.stem for path in EXPERIMENTS}
    assert len(PAPER_EXPERIMENTS) == 3 + 2 + 3


@pytest.mark.parametrize("experiment", PAPER_EXPERIMENTS)
def test_the_papers_settings_are_those_of_section_4_1(experiment: str) -> None:
    config = composed_experiment(experiment, "data.root=/nowhere")
    assert config.model.encoder.backbone == "resnet50"
    assert config.crop_size == config.data.crop.size == 224
    assert (config.data.batch_size, config.trainer.max_epochs) == (64, 200)
    assert config.optimizer._target_ == "torch.optim.Adam"
    assert (config.optimizer.lr, config.optimizer.weight_decay) == (1e-5, 1e-4)
    assert config.optimizer.schedule is None
    assert config.hand._target_ == "hand_recon.hand.mano.hand.mano_hand"


@pytest.mark.parametrize("experiment", PAPER_EXPERIMENTS)
def test_the_report_finds_no_difference_to_the_papers_rows(experiment: str) -> None:
    """The list of what differs is empty for the experiment itself: only the test hands are not known yet."""
    dataset = PAPER_EXPERIMENTS[experiment]
    config = composed_experiment(experiment, "data.root=/nowhere")
    settings = flattened(OmegaConf.to_container(config, resolve=False))  # type: ignore[arg-type]  # a mapping
    settings |= {
        "data": dataset,
        "test_hands": {"freihand": "3960", "ho3d": "20137"}.get(dataset, "1"),
    }
    settings["crop_size"] = str(config.crop_size)
    assert differences(settings, dataset, experiment) == ()


def test_the_shares_of_3d_labels_are_those_of_the_table() -> None:
    shares = {
        name: composed_experiment(name, "data.root=/nowhere")
        .get("supervision", {})
        .get("fraction", 0.0)
        for name in ("table3b_0", "table3b_10", "table3b_100")
    }
    assert shares == {"table3b_0": 0.0, "table3b_10": 0.1, "table3b_100": 1.0}


@pytest.mark.parametrize(
    "experiment", ["table2_freihand", "table3b_0", "table3b_10", "table3b_100"]
)
def test_freihands_experiments_compare_surfaces_in_manos_numbering(experiment: str) -> None:
    config = composed_experiment(experiment, "data.root=/nowhere")
    data = build_data(config)
    assert (data.name, data.crop_size, config.data.topology) == ("freihand", 224, "mano")


def adversarial_prior(root: str) -> DictConfig:
    """The prior of Table 3 (a)'s data-driven row, without the dataset that it is trained on."""
    own = OmegaConf.load(Path(CONF) / "experiment" / "table3a_adversarial.yaml")
    assert isinstance(own, DictConfig)
    prior = OmegaConf.merge(composed("prior=adversarial").prior, own.prior)
    assert isinstance(prior, DictConfig)
    prior.adversarial.real.root = root
    return prior


def test_the_data_driven_prior_takes_its_real_hands_from_freihand(hand: HandModel) -> None:
    term = build_prior(adversarial_prior("/nowhere/FreiHAND"), hand).terms["adversarial"]
    assert isinstance(term, AdversarialTerm)
    adversary = term.adversary
    assert isinstance(adversary.source, FreiHandDataModule)
    assert str(adversary.source.recipe.root) == "/nowhere/FreiHAND"
    assert adversary.learning_rate == 1e-4


def test_a_data_driven_prior_without_its_hands_says_which_folder_is_missing(
    hand: HandModel,
) -> None:
    with pytest.raises(MissingMandatoryValue, match=r"adversarial\.real\.root"):
        build_prior(adversarial_prior("???"), hand)
