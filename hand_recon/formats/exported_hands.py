"""Hands of a file of hands, grouped and ready for the files of other programs.

A clip is one scene with a motion for each of its hands. Photographs are a scene each, whose hands have one
frame; hands without an image, such as those of a file of landmarks, are scenes of their own.
"""

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from jaxtyping import Float

from hand_recon.detection.detector import Side
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory

logger = logging.getLogger(__name__)

CLIP: Final = "clip"
"""Name of the scene of a clip."""

_LONGEST_NAME: Final = 120
"""Bytes of a scene's name; file systems take 255, with what formats add."""


@dataclass(frozen=True)
class ExportedHand:
    """One hand: its motion, and what the file of hands says about its landmarks."""

    trajectory: Trajectory
    """Motion; a hand of a photograph has one frame."""
    landmarks: Float[np.ndarray, "frame landmark=21 3"]
    """Landmarks of each frame, camera frame, metres."""
    covariance: Float[np.ndarray, "frame landmark=21 3 3"]
    """Covariance of each landmark from the hand's origin, axes of the camera, square metres; NaN without an
    estimate."""

    @property
    def name(self) -> str:
        """Name that tells the hand from others of its scene, such as `hand_1_left`."""
        return f"hand_{self.trajectory.hand}_{self.trajectory.side}"


@dataclass(frozen=True)
class Scene:
    """Hands before one camera: those of a clip, of a photograph, or a single one."""

    name: str
    """Name without characters that file systems refuse, different for each scene."""
    hands: tuple[ExportedHand, ...]
    """One hand or more."""
    image: str | None = None
    """File name of the photograph; None for a clip and for landmarks alone."""

    @property
    def trajectories(self) -> list[Trajectory]:
        """Motion of each hand."""
        return [hand.trajectory for hand in self.hands]

    @property
    def is_still(self) -> bool:
        """True for one moment, as of a photograph."""
        return len(self.frames) == 1

    @property
    def frames(self) -> dict[int, float]:
        """Time of each frame with a hand, seconds, by its number, in order."""
        times = {
            frame: time
            for one in self.trajectories
            for frame, time in zip(one.frames.tolist(), one.times.tolist(), strict=True)
        }
        return dict(sorted(times.items()))


@dataclass(frozen=True)
class ExportedHands:
    """Hands to write, and the model that they are hands of."""

    scenes: tuple[Scene, ...]
    """One scene or more."""
    hand: HandModel
    """Model of the right hand."""

    def __iter__(self) -> Iterator[tuple[Scene, ExportedHand]]:
        """Every hand with its scene."""
        return ((scene, hand) for scene in self.scenes for hand in scene.hands)


def exported_hands(records: HandRecords, hand: HandModel) -> ExportedHands:
    """Group the hands of a file; hands that are not fitted are left out with a message.

    Args:
        records: The hands.
        hand: Model of the right hand.

    Raises:
        ValueError: No hand is fitted, a hand is of another hand model, or a hand of a clip has two shapes,
            two sides or two poses in a frame.
    """
    _check_model(records, hand)
    rows = np.flatnonzero(records.fitted).tolist()
    left_out = len(records) - len(rows)
    if not rows:
        raise ValueError(
            f"Found no fitted hand among {len(records)} in the file of hands; expected one or more. "
            + ("The reasons are in it, under `reasons`." if len(records) else "The file is empty.")
        )
    if left_out:
        logger.warning("Left out %d of %d hands, which are not fitted.", left_out, len(records))
    scenes: dict[tuple[str, str | int], list[ExportedHand]] = {}
    for key, of_hand in _by_hand(records, rows).items():
        number = key[2] if key[0] == CLIP else len(scenes.get(key[:2], ())) + 1
        scenes.setdefault(key[:2], []).append(_exported(records, of_hand, number))
    return ExportedHands(tuple(_named(records, scenes)), hand)


def _check_model(records: HandRecords, hand: HandModel) -> None:
    """Refuse hands of another model than the one that is given."""
    found = sorted(set(records.hand_models) - {hand.name})
    if found:
        cure = (
            "Add hand=mano (and hand.path=<folder> if it is not data/mano)."
            if found == ["mano"]
            else f"Give the model of these hands, hand={found[0]}; one file has hands of one model."
        )
        raise ValueError(
            f"The file has hands of the hand model {', '.join(found)}; the model to export with is "
            f"{hand.name}, whose angles and shapes mean other hands. {cure}"
        )


def _by_hand(
    records: HandRecords, rows: Sequence[int]
) -> dict[tuple[str, str | int, int], list[int]]:
    """Rows of each hand, by its kind of scene, its scene and its number there."""
    found: dict[tuple[str, str | int, int], list[int]] = {}
    for row in rows:
        moment, image = records.moments[row], records.images[row]
        if moment is not None:
            key: tuple[str, str | int, int] = (CLIP, CLIP, moment.hand)
        elif image is not None:
            key = ("image", image, row)
        else:
            key = ("hand", row, row)
        found.setdefault(key, []).append(row)
    return found


def _exported(records: HandRecords, rows: list[int], number: int) -> ExportedHand:
    """One hand of the rows of a file, in the order of time."""
    moments = [records.moments[row] for row in rows]
    frames = np.array([0 if one is None else one.frame for one in moments])
    rows = [rows[place] for place in np.argsort(frames, kind="stable")]
    moments = [records.moments[row] for row in rows]
    sides = {records.sides[row] for row in rows}
    frames = np.sort(frames)
    spread = np.ptp(records.shape[rows], axis=0).max()
    if len(sides) > 1 or spread > 0 or (np.diff(frames) == 0).any():
        raise ValueError(
            f"Hand {number} of the clip has the sides {sorted(sides)}, shapes that differ by {spread:g} and "
            f"{len(rows)} poses in {len(set(frames.tolist()))} frames; expected one side, one shape and one "
            "pose in a frame. Export the file of one clip, as hand-recon predict wrote it."
        )
    trajectory = Trajectory(
        hand=number,
        side=cast(Side, sides.pop()),
        frames=frames,
        times=np.array([0.0 if one is None else one.time for one in moments]),
        joint_angles=np.radians(records.joint_angles_degrees[rows]),
        root_rotation=records.root_rotation[rows],
        translation=records.translation[rows],
        shape=records.shape[rows[0]],
        observed=np.array([one is None or one.seen for one in moments]),
    )
    return ExportedHand(trajectory, records.landmarks_3d[rows], records.covariance_3d[rows])


def _named(
    records: HandRecords, scenes: dict[tuple[str, str | int], list[ExportedHand]]
) -> Iterator[Scene]:
    """Scenes with names of their own."""
    taken: set[str] = set()
    for (kind, key), hands in scenes.items():
        given = records.names[key] if isinstance(key, int) else key
        stem = re.sub(r"\.[A-Za-z0-9]{1,5}$", "", given) if kind == "image" else given
        stem = re.sub(r"[^\w.-]+", "-", stem).strip("-.")
        stem = stem.encode()[:_LONGEST_NAME].decode(errors="ignore") or "hand"
        name, number = stem, 2
        # Some file systems do not tell capitals from small letters.
        while name.lower() in taken:
            name, number = f"{stem}-{number}", number + 1
        taken.add(name.lower())
        yield Scene(name, tuple(hands), given if kind == "image" else None)
