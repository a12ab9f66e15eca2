"""A clip of two moving hands with ground truth, and a detector that knows where they are."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from omegaconf import DictConfig, open_dict

from hand_recon.camera import project
from hand_recon.detection.detector import DetectedHand, Detections, Side
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandParameters
from tests.support.configurations import composed
from tests.support.video_files import number_of, write_clip

WIDTH, HEIGHT, FRAMES, RATE = 640, 480, 20, 25.0
FOCAL: Final = 1.2 * WIDTH
QUICK: Final = (
    "descent.starts=1",
    "lifter=none",
    "motion.video=null",
    "motion.plot=false",
    "motion.glb=false",
)
"""Words that leave out what a test does not look at."""


@dataclass
class ScriptedDetector:
    """A detector that reads the number of a frame from its grey level."""

    hands: dict[Side, Float[np.ndarray, "frame 21 2"]]
    """Landmarks of each hand in every frame, pixels; NaN where it is not found."""
    wrong_side: frozenset[tuple[Side, int]] = frozenset()
    """Hands and frames that are taken for the other side."""
    name: str = "scripted"
    calls: list[int] = field(default_factory=list)
    """Numbers of the frames that were looked at."""

    def __call__(self, image: np.ndarray, file: Path | None = None) -> Detections:
        number = number_of(image)
        self.calls.append(number)
        found = []
        for side, points in self.hands.items():
            if np.isfinite(points[number]).all():
                other: Side = "left" if side == "right" else "right"
                seen = other if (side, number) in self.wrong_side else side
                found.append(DetectedHand(points[number], seen, 0.97, 0.9))
        return Detections(tuple(found))


def moving_hand(hand: HandModel, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """A hand that closes and turns.

    Returns:
        Its landmarks in every frame, metres, camera frame; and their projections, pixels.
    """
    share = torch.linspace(0, 1, FRAMES)[:, None]
    angles = torch.zeros(FRAMES, 15, 3)
    angles[..., 0] = 0.1 + 0.6 * share
    turn = torch.tensor([[0.4, 0.3, 0.2]]) * share + torch.tensor([[0.0, 1.6, 3.0]])
    place = torch.tensor([[0.12, 0.02, 0.55]]) + torch.tensor([[0.02, 0.0, 0.05]]) * share
    parameters = HandParameters(
        angles, torch.zeros(FRAMES, 10), axis_angle_to_rotation(turn), place
    )
    points = hand.to_camera(parameters).landmarks
    if side == "left":
        points = points * torch.tensor([-1.0, 1.0, 1.0])
    camera = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    pixels = project(points, camera.expand(FRAMES, 3, 3))
    return points.double().numpy(), pixels.double().numpy()


def noisy(pixels: np.ndarray, sigma: float = 0.5) -> np.ndarray:
    """Pixels with noise."""
    return pixels + np.random.default_rng(5).normal(scale=sigma, size=pixels.shape)


def clip_file(folder: Path) -> Path:
    """The frames, which show their numbers alone."""
    return write_clip(folder / "clip.mp4", FRAMES, RATE, width=WIDTH, height=HEIGHT)


def asked(clip: Path | str, output: Path, *overrides: str) -> DictConfig:
    """`conf/predict.yaml` composed for a clip."""
    config = composed(
        f"input=['{clip}']", "detector.copies=0", f"output='{output}'", *QUICK, *overrides,
        name="predict",
    )  # fmt: skip
    with open_dict(config):
        del config["hydra"]
    return config
