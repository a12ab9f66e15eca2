"""Hands of a clip as landmarks to fit: one camera for all frames, one side and number for each hand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.origin import Moment, Origin
from hand_recon.fitting.photo_camera import CameraChoice, PhotoCamera
from hand_recon.motion.identity import Track
from hand_recon.runs.clip.found_frames import FoundFrame, with_side
from hand_recon.runs.looking import LookedAt, to_landmarks, with_given

LARGEST_SHARE = 0.95
"""Share of the hands of a clip that are not larger than the size by which its camera is assumed: a single
large one is a mistake of the detector."""


@dataclass(frozen=True)
class HandOfClip:
    """One hand of a clip in the frames in which it was seen."""

    track: Track
    """Number, side, frames and gaps."""
    landmarks: ImageLandmarks
    """Landmarks of each of these frames."""
    origins: tuple[Origin, ...]
    """Origin of the hand in each of them."""


def camera_of_clip(frames: Sequence[FoundFrame], choice: CameraChoice) -> PhotoCamera:
    """The one camera of all frames, if there is no file of cameras.

    Args:
        frames: Frames of the clip, at least one.
        choice: Rule by which the camera is determined.

    Raises:
        ValueError: The focal length is to come from EXIF, which a clip does not have.
    """
    sides = [float(np.ptp(hand.landmarks_2d, axis=0).max()) for one in frames for hand in one.hands]
    known = [side for side in sides if np.isfinite(side)]
    large = np.quantile(known, [LARGEST_SHARE]) if known else np.zeros(0)
    return choice.of_photo(frames[0].size, None, large)


def hands_of_clip(
    frames: Sequence[FoundFrame],
    tracks: Sequence[Track],
    choice: CameraChoice,
    *,
    name: str,
    origin: Origin,
    camera: PhotoCamera | None = None,
) -> list[HandOfClip]:
    """Collect the landmarks of each hand.

    Args:
        frames: All frames of the clip.
        tracks: Hands of the clip, with the frames and detections that are theirs.
        choice: Rule by which the camera is determined.
        name: Name of the clip.
        origin: What all hands have in common.
        camera: Camera of all frames, if it is known already and not of a file.

    Raises:
        ValueError: As of `camera_of_clip`; or the camera is of another size.
    """
    by_number = {frame.number: frame for frame in frames}
    if camera is None and choice.cameras is None:
        camera = camera_of_clip(frames, choice)
    found = []
    for track in tracks:
        looked = [
            _looked_at(with_side(by_number[frame], place, track.side), name, choice, camera)
            for frame, place in zip(track.frames.tolist(), track.detections.tolist(), strict=True)
        ]
        landmarks, origins = to_landmarks(looked, origin)
        names = tuple(f"hand {track.number}, frame {frame}" for frame in track.frames.tolist())
        moments = zip(origins, track.frames.tolist(), track.times.tolist(), strict=True)
        of_clip = tuple(
            replace(one, moment=Moment(track.number, frame, time)) for one, frame, time in moments
        )
        found.append(HandOfClip(track, replace(landmarks, names=names), of_clip))
    return found


def _looked_at(
    frame: FoundFrame, name: str, choice: CameraChoice, camera: PhotoCamera | None
) -> LookedAt:
    """A frame with one hand as a photograph with its camera."""
    seen = LookedAt(frame.number, name, size=frame.size, hands=frame.hands, estimate=frame.estimate)
    if camera is None:
        return with_given(seen, choice)
    return replace(seen, camera=camera.matrix, camera_source=camera.source)
