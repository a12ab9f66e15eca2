"""Fits of the same landmarks with each row's knowledge, kept ready between requests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from omegaconf import DictConfig

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.in_parts import Fitter, fit_part
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.model import HandModel
from hand_recon.page.knowledge_rows import KnowledgeRow, row_config
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_fitter


@dataclass(frozen=True)
class GivenHands:
    """Hands to fit: what all rows have in common."""

    landmarks: ImageLandmarks
    """Their landmarks."""
    origins: tuple[Origin, ...]
    """Origin of each."""
    before: str
    """Steps that gave the landmarks."""


@dataclass(frozen=True)
class PosedRecords:
    """Hands with their meshes."""

    records: HandRecords
    """The hands."""
    vertices: Float[np.ndarray, "hand vertex 3"]
    """Mesh vertices, camera frame, metres; NaN for hands without a result."""


class RowFits:
    """One fit for each row, all of one hand model.

    Args:
        config: `conf/demo.yaml` composed.
        rows: The rows.
    """

    def __init__(self, config: DictConfig, rows: Sequence[KnowledgeRow]) -> None:
        self.configs = {row.key: row_config(row, config) for row in rows}
        self.hand: HandModel = build_hand(self.configs[rows[-1].key])
        self.fitters: dict[str, Fitter] = {
            key: build_fitter(one, self.hand) for key, one in self.configs.items()
        }

    def __call__(self, given: GivenHands, key: str) -> PosedRecords:
        """Fit some hands with the knowledge of a row.

        Args:
            given: The hands' landmarks.
            key: The row's key.
        """
        source = source_of(self.configs[key], self.hand, given.before).source
        own = tuple(replace(origin, source=source) for origin in given.origins)
        part = fit_part(given.landmarks, self.fitters[key], own)
        return PosedRecords(to_records(part), part.prediction.vertices.double().numpy())
