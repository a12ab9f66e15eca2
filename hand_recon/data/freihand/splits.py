"""Training, validation and test splits of FreiHAND (Sec. 4.1)."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.freihand.files import FreiHandPart, find_evaluation, load_list, open_part
from hand_recon.data.held_out import check_held_out

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class FreiHandRecipe:
    """Settings of FreiHAND: files, splits, crops and reading.

    Raises:
        ValueError: An option has an unknown value.
    """

    root: Path | str
    """The folder that holds `training_xyz.json`."""
    crop: CropPolicy = field(default_factory=CropPolicy)
    """Size and position of the crops."""
    test_crop: CropPolicy | None = None
    """Size and position of the test crops, if different: the evaluation part has no masks."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches and the number of damaged images allowed."""
    eval_root: Path | str | None = None
    """The folder that holds `evaluation_xyz.json`, if it is not the same or `<root>_eval`."""
    versions: Sequence[str] | None = None
    """Colourings to train on; None for all available. Other splits use the first one only."""
    val_fraction: float = 0.1
    """Share of the training hands for validation; as many again for testing without an evaluation part."""
    split_seed: int = 0
    """Seed of the split, the same for all seeds of a study."""
    test_source: str = "auto"
    """`evaluation`, `held_out` training hands, or `auto`: the first that there is."""
    vertices: int | None = 778
    """Vertices of the hand model; surfaces with another number are left out. None takes any."""
    topology: str = "open"
    """The hand model's name: surfaces numbered as MANO's are compared with MANO only."""

    def __post_init__(self) -> None:
        check_held_out(self.test_source, self.val_fraction)


def choose_hands(
    split: str, recipe: FreiHandRecipe
) -> tuple[FreiHandPart, Int[np.ndarray, " chosen"]]:
    """Part and hands of a split; all colourings of a hand are in one split.

    Args:
        split: `train`, `val` or `test`.
        recipe: Location of the files and source of test hands.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: The files contradict each other.
    """
    cache = recipe.reading.folder
    root = Path(recipe.root).expanduser()
    evaluation = find_evaluation(root, recipe.eval_root)
    held_out = (
        evaluation is None if recipe.test_source == "auto" else recipe.test_source == "held_out"
    )
    if split == "test" and not held_out:
        if evaluation is None:
            raise FileNotFoundError(
                f"No evaluation_xyz.json in {recipe.eval_root or recipe.root}. It is part of "
                "FreiHAND_pub_v2_eval.zip: unpack that and set data.eval_root, or test on "
                "held-out training hands with data.test_source=held_out."
            )
        part = open_part(evaluation[0], "evaluation", cache, evaluation[1])
        return part, np.arange(len(part))
    part = open_part(root, "training", cache)
    order = np.random.default_rng(recipe.split_seed).permutation(len(part))
    count = max(1, round(recipe.val_fraction * len(part)))
    ends = {"val": (0, count), "test": (count, 2 * count)}
    ends["train"] = (2 * count if held_out else count, len(part))
    if split == "test":
        logger.warning(
            "No evaluation_xyz.json: testing on %d held-out hands of %s. Numbers on them are "
            "not FreiHAND's benchmark.", count, root,
        )  # fmt: skip
    start, end = ends[split]
    return part, np.sort(order[start:end])


def training_mano(
    recipe: FreiHandRecipe,
) -> tuple[Float[np.ndarray, "hand number=61"], Float[np.ndarray, "hand 3 3"]] | None:
    """MANO's parameters of the training hands as stored, and their camera matrices.

    Args:
        recipe: Location of the files.

    Returns:
        None where there is no `training_mano.json`.

    Raises:
        ValueError: The file does not fit the others.
    """
    part, hands = choose_hands("train", recipe)
    if not (part.root / "training_mano.json").is_file():
        return None
    labels = load_list(part.root, "training", "mano", (len(part), 1, 61), recipe.reading.folder)
    return labels[hands, 0], part.intrinsics[hands]
