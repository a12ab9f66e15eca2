"""Networks and rows of Table 1 without Hydra, with the numbers of `conf/` (Sec. 4.1, Table 1).

`tests/tools/test_gpu_rows.py` compares them with what `conf/model`, `conf/prior`, `conf/data_term` and
`conf/augmentation` compose to.
"""

from functools import partial
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.appearance import Appearance
from hand_recon.data.augment import Augmentation
from hand_recon.evaluation.hand_scores import Scores
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.penetration.contact import Contacts
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.knowledge.terms import NonPenetrationTerm, RangeOfMotionTerm, ShapeTerm, Term
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty import DataTerm, NegativeLogLikelihood, SquaredError, Staged

ROWS: Final = (1, 2, 3, 4, 5)
"""Rows of Table 1."""

VIEW: Final = 0.8235
"""Side of the part of a crop that the network looks at, as a share of the crop's."""

CLIP: Final = 3e5
"""Largest norm of the gradient."""

WEIGHT_DECAY: Final = 1e-2
"""Weight decay of AdamW."""

SOLID_ANGLES: Final = 1 << 24
"""Solid angles in memory at once on a GPU, where many small lots take longer than a few large ones."""


class WholeBatch(NonPenetration):
    """Eq. 4 for all hands of a batch at once: the same value, with fewer and larger steps for a GPU."""

    @torch.no_grad()
    def contacts(self, hands: Float[Tensor, "hand vertex 3"], least: float) -> Contacts:
        """All vertices deeper than `least` inside another part, each with its nearest triangle."""
        return self._contacts_of_some(hands, least)


def non_penetration(hand: HandModel, *, on_gpu: bool) -> NonPenetration:
    """Eq. 4 with the paper's numbers (conf/prior/full.yaml), as scores need it, arranged for a device."""
    if on_gpu:
        return WholeBatch(hand, geodesic=0.02, tolerance=0.006, at_once=SOLID_ANGLES)
    return NonPenetration(hand, geodesic=0.02, tolerance=0.006)


def prior_of_row(row: int, hand: HandModel) -> Prior:
    """Prior of a row of Table 1 (conf/prior); on a GPU, nothing in it waits for the device (decision 99).

    Args:
        row: 1 to 5.
        hand: The hand model.

    Raises:
        ValueError: There is no such row.
    """
    if row not in ROWS:
        raise ValueError(f"Table 1 has the rows {list(ROWS)}, found {row}.")
    terms: dict[str, Term] = {}
    if row >= 2:
        anatomy = FunctionalAnatomy(
            splay_by_bend=True,
            bend_by_splay=False,
            pip_by_dip=True,
            thumb_cmc=True,
            variant="paper",
        )
        terms["range_of_motion"] = RangeOfMotionTerm(
            hand, weight=20_000.0, ranges="literature", anatomy=anatomy if row >= 3 else None
        )
    if row >= 4:
        terms["non_penetration"] = NonPenetrationTerm(
            hand, weight=20_000.0, tolerance=0.006, geodesic=0.02, sizes="auto"
        )
    terms["shape"] = ShapeTerm(hand, weight=10.0)
    return Prior(terms)


def data_term_of_row(row: int) -> DataTerm:
    """Data term of a row of Table 1 (conf/data_term): the squared error, in row 5 then the likelihood."""
    if row < 5:
        return SquaredError()
    return Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=True)


def photo_network(hand: HandModel, backbone: str, weights: str, *, frozen: int) -> Regressor:
    """Network of conf/model/photos.yaml with a backbone.

    Args:
        hand: The hand model.
        backbone: Name of the backbone, as for `build_backbone`.
        weights: `imagenet`, `none`, or the path of a state dict.
        frozen: Number of leading layers of the backbone that keep their weights.
    """
    landmarks = LandmarkEncoder(512, 2, 0.1, confidence=True)
    encoder = PhotoEncoder(
        backbone, weights, landmarks=landmarks, frozen=frozen, width=256, map_width=96, view=VIEW,
        turns=(-20.0, 20.0), gives_landmarks=False, given_share=0.25, given_noise=5.0,
    )  # fmt: skip
    return Regressor(
        encoder, hand, iterations=3, width=512, dropout=0.0, activation=True, use_intrinsics=False,
        reprojection=True,
    )  # fmt: skip


def photo_augmentation() -> Augmentation:
    """Augmentation of conf/augmentation/photos.yaml."""
    appearance = Appearance(
        outside=0.5, contrast=0.3, grey=0.1, blur=0.2, noise=0.02, patches=0.5, patch_side=0.38
    )
    return Augmentation(
        rotation=0.7854, scale=0.25, shift=0.06, side_jitter=0.0, colour=0.2, brightness=0.1, flip=0.0,
        appearance=appearance,
    )  # fmt: skip


def module_of_row(
    row: int, network: Regressor, *, learning_rate: float, on_gpu: bool
) -> HandReconstruction:
    """Losses, scores and optimizer of a row (conf/recipe/photos.yaml), to be moved to a device.

    Args:
        row: 1 to 5.
        network: The network, on the CPU.
        learning_rate: Highest learning rate of AdamW, which updates all weights in one kernel.
        on_gpu: Whether the scores' non-penetration is arranged for a GPU.
    """
    penetration = non_penetration(network.hand, on_gpu=on_gpu)
    return HandReconstruction(
        network,
        prior_of_row(row, network.hand),
        data_term_of_row(row),
        scores=partial(Scores, load_ranges("literature"), penetration),
        optimizer=partial(
            torch.optim.AdamW, lr=learning_rate, weight_decay=WEIGHT_DECAY, fused=True
        ),
        located_weight=20.0,
    )
