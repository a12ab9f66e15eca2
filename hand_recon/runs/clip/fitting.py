"""Fits one hand of a clip in every frame, with one shape, keeping several minima (Sec. 3.4)."""

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from hand_recon.command_line.resolvers import register_resolvers
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.processes import end_with_parent
from hand_recon.data.progress import with_progress
from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.fitting.descent import Descent, fit_minima
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.minima import Minima
from hand_recon.fitting.second_order.solver import QUICK
from hand_recon.fitting.start import Start
from hand_recon.motion.certainty import estimates_of
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.runs.clip.hands_of_clip import HandOfClip
from hand_recon.runs.configuration import build_hand, configure_process, instantiate, plain
from hand_recon.runs.fitters import build_fitter, build_objective, further_starts
from hand_recon.runs.one_person import hands_of_person, shape_of_person
from hand_recon.schema import HandBatch

logger = logging.getLogger(__name__)

PIECE: Final = 64
"""Frames that are fitted together."""

SHAPE_FROM: Final = 96
"""Most frames that a hand's shape is estimated from, three times as many as `shared_shape.MOST_HANDS`."""

WORTH_A_PROCESS: Final = 4
"""Pieces per process from which on it pays to start one, which takes some seconds."""

_FIELDS: Final = ("joint_angles", "root_rotation", "place", "certainty", "cost")


@dataclass(frozen=True)
class _Piece:
    """Frames of one hand that are fitted together."""

    path: Path
    """File of the results."""
    landmarks: ImageLandmarks
    """Landmarks of the frames."""
    shape: Tensor
    """Shape of the hand, standard deviations."""


def fit_clip(
    config: DictConfig, hands: Sequence[HandOfClip], folder: Path, processes: int
) -> Iterator[tuple[HandOfClip, Tensor, FrameEstimates]]:
    """Fit the hands of a clip, or those of their frames that are not in the folder yet.

    Args:
        config: `conf/predict.yaml` composed and adapted.
        hands: The hands.
        folder: Folder of the results of pieces, for a command that goes on after a kill.
        processes: Processes that fit at once.

    Yields:
        Each hand with its shape and its minima in every frame, in the order of the hands.

    Raises:
        ValueError: The prior or the hand model has no second-order fit; or the hand has no usable frame.
    """
    shapes = _shapes(config, hands, folder)
    pieces = [_pieces(hand, shape, folder) for hand, shape in zip(hands, shapes, strict=True)]
    todo = [piece for of_hand in pieces for piece in of_hand if not piece.path.exists()]
    run = partial(_fit_to_file, OmegaConf.to_yaml(OmegaConf.create(plain(config))))
    task = f"Fitting {sum(len(piece.landmarks) for piece in todo)} hands, pieces"
    with _pool(min(processes, len(todo) // WORTH_A_PROCESS)) as pool:
        done = map(run, todo) if pool is None else pool.map(run, todo)
        for _ in with_progress(done, len(todo), task):
            pass
    for hand, shape, of_hand in zip(hands, shapes, pieces, strict=True):
        yield hand, shape, _estimates(hand, of_hand)


def _pool(processes: int) -> AbstractContextManager[ProcessPoolExecutor | None]:
    if processes < 2:
        return nullcontext()
    # A fork of a process whose torch has run threads may hang.
    context = get_context("spawn")
    return ProcessPoolExecutor(processes, mp_context=context, initializer=end_with_parent)


def _shapes(config: DictConfig, hands: Sequence[HandOfClip], folder: Path) -> list[Tensor]:
    """Shape of each hand: its own, or with `same_person` the one of all of them."""
    together = [hands] if config.same_person and hands else [[hand] for hand in hands]
    found = []
    for some in together:
        path = folder / f"shape of hand {some[0].track.number}.npy"
        if not path.exists():
            batch = HandBatch.join([hands_of_person(hand.landmarks, SHAPE_FROM) for hand in some])
            _write(path, np.asarray(shape_of_hands(config, batch)))
        found += [torch.from_numpy(np.load(path))] * len(some)
    return found


def shape_of_hands(config: DictConfig, hands: HandBatch) -> Tensor:
    """Shape of hands of one person, standard deviations; the mean one without any hand.

    Args:
        config: `conf/predict.yaml` composed and adapted.
        hands: The hands, in crops of 224 pixels.
    """
    if not len(hands):
        return torch.zeros(10)
    hand = build_hand(config)
    fitter = build_fitter(config, hand)
    if len(hands) == 1:
        return fitter(hands).prediction.parameters.shape[0]
    found = shape_of_person(
        fitter,
        build_objective(config, hand),
        instantiate(config.descent),
        hands,
        sigma_at_half_confidence=config.sigma_at_half_confidence,
    )
    logger.info(
        "One shape for a hand of the clip, %.1f standard deviations from the mean, estimated from %d frames.",
        float(found.norm()), len(hands),
    )  # fmt: skip
    return found


def _pieces(hand: HandOfClip, shape: Tensor, folder: Path) -> list[_Piece]:
    pieces = []
    for first in range(0, len(hand.landmarks), PIECE):
        rows = torch.arange(first, min(first + PIECE, len(hand.landmarks)))
        path = folder / f"hand {hand.track.number} from {first}.npz"
        pieces.append(_Piece(path, hand.landmarks.select(rows), shape))
    return pieces


def _estimates(hand: HandOfClip, pieces: Sequence[_Piece]) -> FrameEstimates:
    read = [_read(piece.path) for piece in pieces]
    columns = {name: np.concatenate([one[name] for one in read]) for name in _FIELDS}
    return FrameEstimates(frames=hand.track.frames, times=hand.track.times, **columns)


def _read(path: Path) -> dict[str, np.ndarray]:
    """Arrays of a file, which is closed: a long clip has more pieces than a process may have open files."""
    with np.load(path) as content:
        return {name: content[name] for name in _FIELDS}


def _fit_to_file(config: str, piece: _Piece) -> None:
    """Fit a piece in any process."""
    found = _fit_of(config, tuple(piece.shape.tolist()))(to_crops(piece.landmarks).batch)
    frames = np.arange(len(found))
    estimates = estimates_of(found, frames, frames.astype(float))
    columns = {name: getattr(estimates, name).copy() for name in _FIELDS}
    # Frames with too few landmarks have a result, which is that of the prior alone.
    columns["cost"][~piece.landmarks.usable.numpy()] = np.inf
    _write(piece.path, columns)


@lru_cache(maxsize=2)
def _fit_of(text: str, shape: tuple[float, ...]) -> "ShapeFit":
    """The fit of hands of a shape, built once in each process."""
    register_resolvers()
    config = cast("DictConfig", OmegaConf.create(text))
    configure_process(config.threads)
    return ShapeFit(config, torch.tensor(shape))


class ShapeFit:
    """Fit of hands of one shape, which keeps several minima of each."""

    def __init__(self, config: DictConfig, shape: Tensor) -> None:
        """Build the fit.

        Args:
            config: `conf/predict.yaml` composed and adapted.
            shape: Shape of the hands, standard deviations.
        """
        self.shape = shape
        self.sigma_at_half_confidence = config.sigma_at_half_confidence
        hand = build_hand(config).of_shape(shape)
        self.objective = build_objective(config, hand)
        self.descent: Descent = instantiate(config.descent)
        self.further = further_starts(config, hand)

    def __call__(self, batch: HandBatch, near: Start | None = None) -> Minima:
        """Minima of hands.

        Args:
            batch: The hands, in crops of 224 pixels.
            near: Poses near them, one each, such as those of the frame before, which make it faster.
        """
        seen = observed(batch, self.sigma_at_half_confidence)
        if near is None:
            return fit_minima(seen, self.objective, descent=self.descent, further=self.further)

        def starts(observation: Observation) -> Start:
            found = [near]
            if self.further is not None:
                found.append(self.further(observation))
            return Start.beside(found)

        alone = replace(self.descent, starts=0)
        return fit_minima(seen, self.objective, descent=alone, further=starts, rounds=QUICK)


def _write(path: Path, content: np.ndarray | dict[str, np.ndarray]) -> None:
    """Write an array or several; the file has its name only when it is whole."""
    with replaced_when_whole(path) as unfinished, unfinished.open("wb") as stream:
        if isinstance(content, dict):
            np.savez(stream, **cast("dict[str, Any]", content))
        else:
            np.save(stream, content)
