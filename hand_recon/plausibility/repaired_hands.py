"""Repaired hands: the nearest plausible hand of each audited one, audited again, and its record."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.hand_records import SHAPES, HandRecords
from hand_recon.fitting.origin import Moment
from hand_recon.plausibility.audit import Audit
from hand_recon.plausibility.given_hands import GivenCamera, as_array, rows_by
from hand_recon.plausibility.posed_hands import MIRROR, HandModels, PosedHands
from hand_recon.plausibility.repair import Repair
from hand_recon.plausibility.verdicts import IMPLAUSIBLE, NOT_AUDITED, PLAUSIBLE
from hand_recon.schema import HandParameters

SOURCE: Final = "audit, repair"
"""Steps that made a repaired hand."""

NOT_REPAIRED: Final = (
    "The hand was not repaired: it has fewer than 12 landmarks, or it is MANO's. "
    "Give hand=mano for these."
)
"""Reason of hands without a result."""

_WORDS: Final = {PLAUSIBLE: "plausible", IMPLAUSIBLE: "doubtful", NOT_AUDITED: "not fitted"}
"""Verdicts of a file of hands; those of a repair are plausible unless limits are set below its own."""

NO_CAMERA: Final = GivenCamera(
    np.array([[500.0, 0.0, 112.0], [0.0, 500.0, 112.0], [0.0, 0.0, 1.0]]), "none", None, None
)
"""Made-up camera of hands that no camera saw: 500 px on 224 px, as crops without a camera have."""

NEAREST: Final = 0.1
"""Least depth of a landmark that a made-up camera can show, metres."""

PLACED_AT: Final = 0.6
"""Depth at which hands are placed that would be nearer to a made-up camera or behind it, metres."""


@dataclass(frozen=True)
class RepairedHands:
    """Audited hands and the nearest plausible ones."""

    before: Audit
    """The audit."""
    after: Audit
    """The same audit of the repaired hands."""
    moved: Float[Tensor, "hand landmark=21"]
    """Distance of each repaired landmark from the audited hand's, millimetres; NaN without a pose."""

    def summary(self) -> dict[str, Any]:
        """Violations before and after, and the movement in millimetres."""
        posed = self.after.hands.posed
        moved = self.moved[posed]
        before, after = self.before.findings, self.after.findings
        numbers: dict[str, Any] = {"hands": int(posed.sum())}
        if not len(moved):
            return numbers
        for name, found in (("before", before), ("after", after)):
            numbers |= {
                f"worst_range_degrees_{name}": float(found.worst_range[posed].max()),
                f"worst_anatomy_degrees_{name}": float(found.worst_anatomy[posed].max()),
                f"violating_percent_{name}": 100 * float(_violating(found, posed).double().mean()),
                f"depth_mm_greatest_{name}": float(found.depth[posed].nan_to_num(0.0).max()),
            }
        return numbers | {
            "moved_mm_mean": float(moved.mean()),
            "moved_mm_median_of_hands": float(moved.mean(dim=1).median()),
            "moved_mm_greatest_mean_of_a_hand": float(moved.mean(dim=1).max()),
            "moved_mm_greatest": float(moved.max()),
        }


def _violating(found: Any, posed: Tensor) -> Tensor:  # noqa: ANN401
    """Mask of the hands with any violation at all: an angle outside its range, or penetration of 6 mm."""
    worst = torch.maximum(found.worst_range, found.worst_anatomy)
    return ((worst > 0) | (found.deep.nan_to_num(0.0) > 0))[posed]


@torch.no_grad()
def repaired(before: Audit, models: HandModels) -> RepairedHands:
    """Repair every hand that has a pose.

    Args:
        before: The audit.
        models: Hand models.
    """
    hands = before.hands
    usable = hands.posed & hands.parameters.shape.isfinite().all(dim=1)
    parameters = HandParameters(*(values.clone() for values in vars(hands.parameters).values()))
    landmarks, left_out = torch.full_like(hands.landmarks, torch.nan), ~usable
    for name, rows in rows_by(hands.models).items():
        hand = models.named(name)
        own = torch.tensor([row for row in rows if bool(usable[row])], dtype=torch.long)
        if hand is None:
            left_out[rows] = True
            continue
        if not len(own):
            continue
        target = torch.where(hands.exact[own, None, None], hands.landmarks[own], hands.points[own])
        found = Repair(hand, before.knowledge)(hands.parameters.select(own), target)
        for values, some in zip(vars(parameters).values(), vars(found).values(), strict=True):
            values[own] = some
        landmarks[own] = hand.landmarks_only().to_camera(found).landmarks
    parameters.joint_angles[left_out] = torch.nan
    after = replace(
        hands,
        parameters=parameters,
        landmarks=landmarks,
        exact=torch.ones_like(hands.exact),
        points=torch.full_like(hands.points, torch.nan),
    )
    moved = 1000 * (landmarks - hands.landmarks).norm(dim=-1)
    again = Audit.of(after, models, before.knowledge, before.limits)
    return RepairedHands(before, again, moved)


def to_records(found: RepairedHands, version: str) -> HandRecords:
    """Repaired hands as a file of hands holds them; those without a pose are `not fitted`.

    Args:
        found: The hands.
        version: Version of hand_recon.
    """
    hands = found.after.hands
    given, posed = hands.given, hands.posed.tolist()
    cameras = [one or NO_CAMERA for one in given.cameras]
    numbers = _numbers(hands, cameras)
    return HandRecords(
        names=given.names,
        images=tuple(camera.image for camera in cameras),
        sides=tuple("left" if left else "right" for left in hands.left.tolist()),
        verdicts=tuple(_WORDS[one.value] for one in found.after.verdicts),
        reasons=tuple(
            one.reasons if fitted else (NOT_REPAIRED,)
            for one, fitted in zip(found.after.verdicts, posed, strict=True)
        ),
        cameras=tuple(
            camera.source if one else None for camera, one in zip(cameras, posed, strict=True)
        ),
        image_sizes=tuple(camera.image_size for camera in cameras),
        loss={},
        sources=(SOURCE,) * len(given),
        hand_models=hands.models,
        versions=(version,) * len(given),
        moments=_moments(hands),
        **numbers,
    )


def _numbers(
    hands: PosedHands, cameras: list[GivenCamera]
) -> dict[str, Float[np.ndarray, "hand ..."]]:
    """Numbers of the records: left hands are left hands, and those without a camera are in front of one."""
    count = len(hands)
    mirror = np.where(hands.left.numpy()[:, None], np.array(MIRROR), 1.0)
    parameters = hands.parameters
    landmarks = as_array(hands.landmarks) * mirror[:, None]
    translation = as_array(parameters.translation) * mirror
    unseen = np.array([camera.source == "none" for camera in cameras])
    near = ~(np.nan_to_num(landmarks[..., 2].min(axis=1), nan=0.0) >= NEAREST)
    offset = np.where((unseen & near)[:, None], [0.0, 0.0, PLACED_AT] - translation, 0.0)
    landmarks, translation = landmarks + offset[:, None], translation + offset
    intrinsics = np.stack([camera.intrinsics for camera in cameras])
    pixels = landmarks @ intrinsics.swapaxes(1, 2)
    found = {key: np.full((count, *shape), np.nan) for key, shape in SHAPES.items()}
    rotation = as_array(parameters.root_rotation)
    found |= {
        "landmarks_3d": landmarks,
        "landmarks_2d": pixels[..., :2] / pixels[..., 2:],
        "joint_angles_degrees": np.degrees(as_array(parameters.joint_angles)),
        "shape": as_array(parameters.shape),
        "root_rotation": mirror[:, :, None] * rotation * mirror[:, None],
        "translation": translation,
        "intrinsics": intrinsics,
    }
    kept = hands.posed.numpy()
    for values in found.values():
        values[~kept] = np.nan
    return found


def _moments(hands: PosedHands) -> tuple[Moment | None, ...]:
    """Place of each hand in its clip: the file's, or in its sequence, if that has times.

    Hands are numbered from 1 through all sequences; those of one file of hands keep their numbers.
    """
    given = hands.given
    if len(set(given.files)) == 1 and any(one is not None for one in given.moments):
        return given.moments
    found: list[Moment | None] = [None] * len(given)
    sequences = [(name, rows) for name, rows in rows_by(given.sequences).items() if name]
    for number, (_, rows) in enumerate(sequences, start=1):
        times = given.times[rows]
        if not bool(times.isfinite().all()):
            continue
        for frame, (row, time) in enumerate(zip(rows, times.tolist(), strict=True)):
            own = given.moments[row]
            found[row] = Moment(number, frame, time) if own is None else replace(own, hand=number)
    return tuple(found)
