"""The configuration composes, and its groups and experiments are what they say."""

from pathlib import Path

import pytest
from hydra.core.hydra_config import HydraConfig

from hand_recon.command_line.configuration_files import CONF
from hand_recon.command_line.resolvers import folder_name
from hand_recon.fitting.descent import Descent
from hand_recon.fitting.results import ResultOptions
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import AXES
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.terms import RangeOfMotionTerm
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.lifter_file import fingerprint
from hand_recon.runs.building import build_data, build_module
from hand_recon.runs.configuration import claim_folder, instantiate
from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty import (
    DataTerm,
    FullCovariance,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
)
from tests.support.configurations import composed

EXPERIMENTS = sorted(
    path.stem
    for path in (Path(CONF) / "experiment").glob("*.yaml")
    # Those of Tables 2 and 3 have tests of their own.
    if not path.stem.startswith("table")
)

ROWS = {
    1: ("mse", 0.0, False, 0.0),
    2: ("mse", 20_000.0, False, 0.0),
    3: ("mse", 20_000.0, True, 0.0),
    4: ("mse", 20_000.0, True, 20_000.0),
    5: ("mse_then_nll", 20_000.0, True, 20_000.0),
}
"""Table 1: data term, λ₁, functional anatomy, λ₂."""


def test_the_defaults_are_the_first_run() -> None:
    config = composed()
    assert config.data.level == "easy"
    assert config.crop_size == config.data.crop_size == 64
    assert config.prior.range_of_motion.weight == 20_000.0


@pytest.mark.parametrize(("row", "expected"), list(ROWS.items()))
def test_the_rows_of_table_1_differ_in_prior_and_data_term_alone(
    row: int, expected: tuple[str, float, bool, float]
) -> None:
    default, config = composed(), composed(f"experiment=ablation_row{row}")
    prior = config.prior
    assert HydraConfig.get().runtime.choices["data_term"] == expected[0]
    assert prior.shape.weight == 10.0
    moves = prior.range_of_motion
    assert (0.0 if moves is None else moves.weight) == expected[1]
    assert (moves is not None and moves.anatomy is not None) == expected[2]
    penetrates = prior.non_penetration
    assert (0.0 if penetrates is None else penetrates.weight) == expected[3]
    assert set(prior) == {"range_of_motion", "non_penetration", "shape"}
    for group in ("data", "model", "optimizer", "trainer", "hand"):
        assert config[group] == default[group], group


@pytest.mark.parametrize(("row", "expected"), list(ROWS.items()))
def test_every_row_of_table_1_builds(row: int, expected: tuple[str, float, bool, float]) -> None:
    module = build_module(composed(f"experiment=ablation_row{row}"))
    data_term, range_of_motion, anatomy, non_penetration = expected
    assert module.data_term.stages == (2 if data_term == "mse_then_nll" else 1)
    expected_weights = {
        "range_of_motion": range_of_motion, "non_penetration": non_penetration, "shape": 10.0
    }  # fmt: skip
    expected_weights = {name: weight for name, weight in expected_weights.items() if weight}
    # In the order of Eq. 5, in which they are added.
    assert list(module.prior.weights.items()) == list(expected_weights.items())
    if range_of_motion:
        term = module.prior.terms["range_of_motion"]
        assert isinstance(term, RangeOfMotionTerm)
        assert (term.anatomy is not None) == anatomy
    assert module.supervision is None


def small(*overrides: str) -> HandReconstruction:
    """The module with the smallest backbone, where the backbone is not the point."""
    return build_module(composed(*overrides, "model.encoder.backbone=mobilenet_v3_small"))


GROUPS = ("prior", "data_term", "supervision", "model", "recipe", "data", "optimizer", "logger")
"""Groups of `conf/train.yaml` with a choice."""

MEMBERS = [
    (group, path.stem) for group in GROUPS for path in sorted((Path(CONF) / group).glob("*.yaml"))
]


PLACES = {
    "freihand": ["data.root=/nowhere"],
    "dexycb": ["data.root=/nowhere"],
    "ho3d": ["data.root=/nowhere"],
    "landmarks": ["data.train=/nowhere/labels.json"],
    "shards": ["data.train=/nowhere/shards"],
    "photos": ["photos.train=/nowhere/labels.json"],
    "photos_table1": ["photos.train=/nowhere/labels.json"],
    "mixture": [
        "data.parts.freihand.root=/nowhere",
        "data.parts.landmarks.train=/nowhere/labels.json",
    ],
}
"""Settings that each dataset needs besides its name."""


@pytest.mark.parametrize(("group", "member"), MEMBERS)
def test_every_member_of_every_group_composes_and_builds(group: str, member: str) -> None:
    config = composed(f"{group}={member}", *PLACES.get(member, []))
    if "backbone" in config.model.encoder:
        # The smallest, and without a download.
        config.model.encoder.update(backbone="mobilenet_v3_small", weights="none")
    data = build_data(config)
    module = build_module(config)
    assert module.regressor.hand.landmark_set == data.landmark_set


@pytest.mark.parametrize(
    ("member", "kind", "needs"),
    [
        ("mse", SquaredError, False),
        ("nll", NegativeLogLikelihood, False),
        ("mse_then_nll", NegativeLogLikelihood, False),
        ("beta_nll", NegativeLogLikelihood, False),
        ("laplace", LaplaceLikelihood, False),
        ("mse_rescaled", RescaledSquaredError, False),
        ("full_covariance", FullCovariance, True),
    ],
)
def test_a_data_term_is_what_its_name_says_and_gets_the_regressor_that_it_needs(
    member: str, kind: type[DataTerm], *, needs: bool
) -> None:
    module = small(f"data_term={member}")
    last = module.data_term.second if isinstance(module.data_term, Staged) else module.data_term
    assert type(last) is kind
    assert module.data_term.needs_correlation == needs
    assert ("correlation" in module.regressor.sizes) == needs
    if member == "beta_nll":
        assert isinstance(last, NegativeLogLikelihood)
        assert last.beta == 0.5


def test_the_priors_to_compare_with_are_what_they_say() -> None:
    weights = {
        name: small(f"prior={name}").prior.weights for name in ("none", "pca_mean", "ranges_only")
    }
    assert weights["none"] == {"shape": 10.0}
    assert weights["pca_mean"] == weights["none"] | {"pose_components": 10.0}
    term = small("prior=ranges_only").prior.terms["range_of_motion"]
    assert isinstance(term, RangeOfMotionTerm)
    assert term.upper[:, AXES.index("twist")].isinf().all()
    assert term.upper[:, AXES.index("bend")].isfinite().all()


def test_every_term_of_the_prior_can_be_overridden() -> None:
    """A weight of zero switches a term off, null too, and the rules of functional anatomy are settings."""
    prior = small(
        "prior=full", "prior.range_of_motion.weight=5", "prior.non_penetration.weight=0",
        "prior.range_of_motion.anatomy.variant=printed", "prior.range_of_motion.ranges=paper_release",
        "prior.shape=null",
    ).prior  # fmt: skip
    assert prior.weights == {"range_of_motion": 5}
    term = prior.terms["range_of_motion"]
    assert isinstance(term, RangeOfMotionTerm)
    assert term.anatomy == FunctionalAnatomy(variant="printed")


def test_3d_labels_are_used_only_where_they_are_asked_for() -> None:
    assert small().supervision is None
    supervision = small("supervision=landmarks_3d", "supervision.fraction=0.1").supervision
    assert supervision is not None
    assert (supervision.fraction, supervision.weight) == (0.1, 500_000.0)


def test_a_fused_step_is_for_full_precision_alone() -> None:
    """Lightning refuses to clip gradients for it in mixed precision."""
    assert composed("recipe=lifter").optimizer.fused is True
    mixed = composed("recipe=lifter", "trainer.precision=bf16-mixed")
    assert mixed.trainer.gradient_clip_val == 300_000
    assert mixed.optimizer.fused is None


def test_the_lifter_sees_landmarks_without_pictures() -> None:
    config = composed("recipe=lifter")
    module = build_module(config)
    assert isinstance(module.regressor.encoder, LandmarkEncoder)
    assert module.regressor.skeleton is not None
    data = build_data(config)
    assert (data.name, data.landmark_set, data.augmentation) == ("views", "knuckle", None)


def test_what_fit_can_be_told_composes() -> None:
    for data in (None, "views"):
        for prior in (path.stem for path in (Path(CONF) / "prior").glob("*.yaml")):
            chosen = [f"prior={prior}", *([] if data is None else [f"data={data}"])]
            config = composed(*chosen, name="fit")
            knows = prior in ("full", "natural", "photos")
            assert instantiate(config.descent) == Descent(finger_table=knows)
            assert instantiate(config.results) == ResultOptions()
            assert (config.get("data") is None) == (data is None)


def test_the_paper_recipe_has_the_settings_of_section_4_1() -> None:
    config = composed("recipe=paper", "data=freihand", "data.root=/nowhere")
    assert config.model.encoder.backbone == "resnet50"
    assert config.model.encoder.weights == "imagenet"
    assert (config.crop_size, config.data.batch_size, config.trainer.max_epochs) == (224, 64, 200)
    assert config.optimizer._target_ == "torch.optim.Adam"
    assert (config.optimizer.lr, config.optimizer.weight_decay) == (1e-5, 1e-4)
    assert config.optimizer.schedule is None


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_and_builds_its_data(experiment: str) -> None:
    assert build_data(composed(f"experiment={experiment}")).crop_size == 64


@pytest.mark.parametrize("row", ROWS)
def test_the_rows_of_table_1_go_with_freihand_too(row: int) -> None:
    config = composed(f"experiment=ablation_row{row}", "data=freihand", "data.root=/nowhere")
    assert build_data(config).name == "freihand"


def test_a_dataset_without_its_folder_is_refused_with_the_cure() -> None:
    with pytest.raises(ValueError, match=r"data.root=/path.*data/README.md"):
        build_data(composed("data=freihand"))


def test_long_overrides_make_short_names_that_differ() -> None:
    assert folder_name("+experiment=ablation_row1,seed=2") == "experiment-ablation_row1__seed-2"
    assert folder_name("crop_size=4,experiment=row1") == "experiment-row1__crop_size-4"
    long = ",".join(f"some.key{number}=some/value" for number in range(40))
    names = {folder_name(long), folder_name(long + ",seed=1"), folder_name(long + ",seed=2")}
    assert len(names) == 3
    assert all(len(name.encode()) <= 200 and "/" not in name for name in names)


def test_the_balance_is_kept_in_training_and_not_in_a_fit_unless_it_is_said() -> None:
    assert composed().data_term.keep_balance is True
    assert composed("data_term.keep_balance=false").data_term.keep_balance is False
    assert composed(name="fit").data_term.keep_balance is False
    assert composed("data_term.keep_balance=true", name="fit").data_term.keep_balance is True


@pytest.mark.parametrize(
    "name", sorted(path.stem for path in (Path(CONF) / "debug").glob("*.yaml"))
)
def test_every_debug_setting_is_one_that_the_trainer_has(name: str) -> None:
    trainer = instantiate(composed(f"debug={name}").trainer, logger=False)
    assert trainer.overfit_batches == (2 if name == "overfit" else 0.0)
    assert trainer.max_epochs == (1 if name != "overfit" else composed().trainer.max_epochs)


def test_a_folder_with_a_run_in_it_is_not_written_to(tmp_path: Path) -> None:
    claim_folder(tmp_path / "new")
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(FileExistsError, match="nothing is overwritten"):
        claim_folder(tmp_path)


def test_the_fingerprint_knows_the_hand_and_not_its_landmarks(hand: HandModel) -> None:
    assert fingerprint(open_hand("mano")) == fingerprint(hand)
    changed = open_hand()
    changed.template[0, 0] += 1e-4
    assert fingerprint(changed) != fingerprint(hand)
