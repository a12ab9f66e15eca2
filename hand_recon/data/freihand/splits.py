"""Which of FreiHAND's hands train, validate and test (Sec. 4.1)."""

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
    """Which hands, and how they are cut out and read.

    Raises:
        ValueError: A choice does not exist.
    """

    root: Path | str
    """The folder that holds `training_xyz.json`."""
    crop: CropPolicy = field(default_factory=CropPolicy)
    """Size and position of the crops."""
    test_crop: CropPolicy | None = None
    """The same for test hands, where it differs: the evaluation part has no masks."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Caches, and how many damaged images are too many."""
    eval_root: Path | str | None = None
    """The folder that holds `evaluation_xyz.json`, if it is not the same or `<root>_eval`."""
    versions: Sequence[str] | None = None
    """Which colourings to train on; none for all that are there. Others see the first one only."""
    val_fraction: float = 0.1
    """Share of the training hands that validate; as many again test if nothing else can."""
    split_seed: int = 0
    """Fixes who validates: the same for all seeds of a study."""
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
    """The part that a split reads, and the hands in it; a hand keeps its colourings.

    Args:
        split: `train`, `val` or `test`.
        recipe: Where the files are and who tests.

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
    """MANO's parameters of the training hands as the files have them, and their cameras.

    Args:
        recipe: Where the files are.

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
