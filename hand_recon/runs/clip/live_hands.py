"""Hands of a live video: each frame is fitted from the poses of the frame before, and smoothed forward."""

import logging
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.detection.detector import Side
from hand_recon.fitting.origin import Origin
from hand_recon.fitting.photo_camera import CameraChoice, PhotoCamera
from hand_recon.fitting.second_order.minima import Minima
from hand_recon.fitting.start import Start
from hand_recon.motion.bridging import trajectory_of
from hand_recon.motion.certainty import estimates_of
from hand_recon.motion.filtering import LiveFilter
from hand_recon.motion.identity import Track
from hand_recon.motion.identity_settings import IdentitySettings
from hand_recon.motion.identity_steps import FrameHands, IdentityState, advance
from hand_recon.runs.clip.fitting import ShapeFit, shape_of_hands
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.hands_of_clip import HandOfClip, camera_of_clip, hands_of_clip
from hand_recon.runs.clip.smoothed import SmoothedHand
from hand_recon.schema import HandBatch

logger = logging.getLogger(__name__)

SHAPE_FROM: Final = 40
"""Hands from which the shape is estimated, which all hands share; until then it is the mean one."""

WORTH_SHOWING: Final = 3
"""Frames in which a hand must have been seen to be shown: false detections last for a frame or two."""


@dataclass(frozen=True)
class _LiveHand:
    """A hand that is followed."""

    side: Side
    motion: LiveFilter
    last: Start
    """Pose in the last frame."""
    frames: int
    """Frames in which it was seen, of either side."""


class _LiveFit:
    """Fit of hands of one shape, which is estimated from the first hands in a thread of its own."""

    def __init__(self, config: DictConfig) -> None:
        self.config = config
        self.thread = ThreadPoolExecutor(1)
        self.gathered: list[HandBatch] = []
        self.estimated: Future[Tensor] | None = None
        self.of_shape = ShapeFit(config, torch.zeros(10))

    @property
    def shape(self) -> Tensor:
        """Shape of the hands, standard deviations."""
        return self.of_shape.shape

    def __call__(self, batch: HandBatch, last: list[Start | None]) -> Minima:
        """Minima of the hands of a frame.

        Args:
            batch: The hands.
            last: Pose of each in the frame before; None for a new one.
        """
        self._follow_shape(batch)
        before = [start for start in last if start is not None]
        return self.of_shape(batch, _stacked(before) if len(before) == len(last) else None)

    def _follow_shape(self, batch: HandBatch) -> None:
        """Gather hands, have their shape estimated once there are enough, and take it when it is known."""
        if self.estimated is None:
            self.gathered.append(batch)
            if sum(len(part) for part in self.gathered) >= SHAPE_FROM:
                some = HandBatch.join(self.gathered)
                self.estimated = self.thread.submit(shape_of_hands, self.config, some)
                self.gathered = []
        elif self.estimated.done() and not self.shape.any():
            self.of_shape = ShapeFit(self.config, self.estimated.result())


class LiveHands:
    """Hands of successive frames of a camera or a stream."""

    def __init__(
        self, config: DictConfig, choice: CameraChoice, origin: Origin, seconds: float
    ) -> None:
        """Prepare the fit.

        Args:
            config: `conf/predict.yaml` composed and adapted.
            choice: Rule by which the camera is determined; it is determined once.
            origin: What all hands have in common.
            seconds: Strength of smoothing, seconds.
        """
        self.choice, self.origin, self.seconds = choice, origin, seconds
        self.settings = IdentitySettings(longest_gap=config.motion.longest_gap)
        self.fit = _LiveFit(config)
        self.identity = IdentityState()
        self.hands: dict[int, _LiveHand] = {}
        self.camera: PhotoCamera | None = None

    def __call__(self, frame: FoundFrame, name: str) -> list[SmoothedHand]:
        """Hands of the next frame, each with the motion of this frame alone.

        Args:
            frame: Hands that were found.
            name: Name of the source.

        Raises:
            ValueError: The camera cannot be determined, or the times do not increase.
        """
        seen = FrameHands(frame.number, frame.time, frame.hands)
        self.identity, numbers = advance(self.identity, seen, self.settings)
        remembered = {hand.number for hand in self.identity.hands}
        self.hands = {number: hand for number, hand in self.hands.items() if number in remembered}
        tracks = [
            self._track(place, number, frame) for place, number in enumerate(numbers) if number
        ]
        if not tracks:
            return []
        if self.camera is None and self.choice.cameras is None:
            self.camera = camera_of_clip([frame], self.choice)
        found = hands_of_clip(
            [frame], tracks, self.choice, name=name, origin=self.origin, camera=self.camera
        )
        found = [hand for hand in found if bool(hand.landmarks.usable.all())]
        if not found:
            return []
        batch = HandBatch.join([to_crops(hand.landmarks).batch for hand in found])
        known = [self._known(hand.track) for hand in found]
        minima = self.fit(batch, [None if one is None else one.last for one in known])
        smoothed = [self._smoothed(hand, minima, row) for row, hand in enumerate(found)]
        return [one for one in smoothed if self.hands[one.motion.hand].frames >= WORTH_SHOWING]

    def _known(self, track: Track) -> _LiveHand | None:
        """Knowledge of a hand from earlier frames; none of its pose if its side has changed by the votes."""
        known = self.hands.get(track.number)
        # Poses of a left hand are mirrored, and no motion leads from one side to the other.
        return known if known is not None and known.side == track.side else None

    def _track(self, place: int, number: int, frame: FoundFrame) -> Track:
        return Track(
            number=number,
            side=self.identity.hand(number).side,
            agreement=1.0,
            mean_score=None,
            frames=np.array([frame.number]),
            times=np.array([frame.time]),
            detections=np.array([place]),
            gaps=(),
        )

    def _smoothed(self, hand: HandOfClip, minima: Minima, row: int) -> SmoothedHand:
        """The next pose of a hand."""
        track = hand.track
        here = minima.parameters.select(slice(row, row + 1))
        estimates = estimates_of(minima[row : row + 1], track.frames, track.times)
        known, before = self._known(track), self.hands.get(track.number)
        motion = LiveFilter(self.seconds) if known is None else known.motion
        poses = motion.update(estimates)
        # The next frame's fit begins at the minimum that was chosen, which need not have the least loss.
        chosen = slice(motion.chosen, motion.chosen + 1)
        last = Start(
            here.joint_angles[:, chosen],
            here.root_rotation[:, chosen],
            here.translation[:, chosen],
            here.shape[:, chosen],
        )
        count = 1 if before is None else before.frames + 1
        self.hands[track.number] = _LiveHand(track.side, motion, last, count)
        shape = self.fit.shape.double().numpy()
        moved = trajectory_of(poses, hand=track.number, side=track.side, shape=shape)
        return SmoothedHand(hand, moved)


def _stacked(starts: list[Start]) -> Start:
    """Starts of several hands, one each, as a batch."""
    return Start(
        torch.cat([start.joint_angles for start in starts]),
        torch.cat([start.root_rotation for start in starts]),
        torch.cat([start.translation for start in starts]),
        torch.cat([start.shape for start in starts]),
    )
