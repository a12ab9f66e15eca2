"""Drawings of audited hands: the hand from two sides, with the joints that violate a limit in red."""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8

from hand_recon.hand.skeleton import JOINTS, LANDMARK_OF_JOINT, LANDMARK_PARENTS
from hand_recon.plausibility.audit import Audit
from hand_recon.plausibility.given_hands import as_array
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.verdicts import violations
from hand_recon.rendering.mesh import shade
from hand_recon.visualization.hand_marks import text_strip
from hand_recon.visualization.overlay import draw_landmarks

Image = UInt8[np.ndarray, "_ _ 3"]
"""RGB."""

SIDE: Final = 420
"""Side of one view, pixels."""

MARGIN: Final = 250
"""Width of the labels at the left of a view, pixels."""

RED: Final = (215, 25, 28)
"""Colour of joints beyond a limit."""

ORANGE: Final = (240, 130, 20)
"""Colour of joints that violate a range by less."""

Colour = tuple[int, int, int]

MOST: Final = 12
"""Most labels of a view."""

_LABEL: Final = 15
_FOCAL: Final = 4.0
_DISTANCE: Final = 1.0

# The hand's frame has fingers along −x, the palm towards −y and the thumb at +z.
_VIEWS: Final = {
    "from the palm": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "from the thumb": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
"""Rotations from the hand's frame to that of a camera, fingers upwards."""


@dataclass(frozen=True)
class Drawn:
    """One hand to draw, in the hand's frame."""

    points: Float[np.ndarray, "landmark=21 3"]
    """Landmarks, as given where they are, metres."""
    vertices: Float[np.ndarray, "vertex 3"] | None
    """Mesh; None without its model."""
    faces: Int[np.ndarray, "face 3"] | None
    """Triangles."""
    marks: dict[int, tuple[str, Colour]]
    """Text and colour for each landmark whose joint violates a range."""
    left: bool = False
    """True for left hands, of which all this is the mirror image."""


def draw_hand(audit: Audit, models: HandModels, row: int) -> Image:
    """Draw a hand from the palm and from the thumb, a left hand as a left hand.

    Args:
        audit: The audit.
        models: Hand models.
        row: The hand.
    """
    drawn = replace(_in_own_frame(audit, models, row), left=bool(audit.hands.left[row]))
    return np.concatenate([_view(drawn, name) for name in _VIEWS], axis=1)


def _in_own_frame(audit: Audit, models: HandModels, row: int) -> Drawn:
    hands = audit.hands
    parameters = hands.parameters.select(torch.tensor([row]))
    points = hands.points[row] if bool(hands.points[row].isfinite().any()) else hands.landmarks[row]
    if bool(hands.exact[row]):
        # The pose is drawn; the landmarks of a file may have another origin.
        points = hands.landmarks[row]
    local = (points - parameters.translation[0]) @ parameters.root_rotation[0]
    hand = models.named(hands.models[row])
    if hand is None or not bool(parameters.shape.isfinite().all()):
        return Drawn(as_array(local), None, None, _marks(audit, row))
    geometry = hand(parameters.joint_angles, parameters.shape)
    if bool(hands.exact[row]):
        local = geometry.landmarks[0]
    vertices, faces = as_array(geometry.vertices[0]), hand.faces.cpu().numpy()
    return Drawn(as_array(local), vertices, faces, _marks(audit, row))


def _marks(audit: Audit, row: int) -> dict[int, tuple[str, Colour]]:
    """Labels of the joints, the worst axis of each, that are more than 5° beyond the ranges or anatomy."""
    found: dict[int, tuple[str, Colour]] = {}
    both = (
        *((one, "") for one in violations(audit.findings, row, least=5.0)),
        *((one, " (anatomy)") for one in violations(audit.findings, row, anatomy=True, least=5.0)),
    )
    for one, kind in both:
        landmark = LANDMARK_OF_JOINT[JOINTS.index(one.joint)]
        colour = RED if abs(one.beyond) > audit.limits.degrees else ORANGE
        text = f"{one.joint} {one.axis} {one.beyond:+.0f}°{kind}"
        found.setdefault(landmark, (text, colour))
    return dict(list(found.items())[:MOST])


def _view(drawn: Drawn, name: str) -> Image:
    rotation = _VIEWS[name]
    shown = (
        drawn.points if drawn.vertices is None else np.concatenate([drawn.points, drawn.vertices])
    )
    finite = shown[np.isfinite(shown).all(axis=1)]
    middle = (finite.min(axis=0) + finite.max(axis=0)) / 2
    extent = np.abs((finite - middle) @ rotation.T).max() / 0.42
    camera = np.array([[_FOCAL * SIDE, 0, SIDE / 2], [0, _FOCAL * SIDE, SIDE / 2], [0, 0, 1.0]])

    def placed(points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        return (points - middle) @ rotation.T / extent / _FOCAL + [0.0, 0.0, _DISTANCE]

    image: Image = np.full((SIDE, SIDE, 3), 255, dtype=np.uint8)
    if drawn.vertices is not None and drawn.faces is not None:
        image = shade(placed(drawn.vertices), drawn.faces, camera, SIDE).over(image, opacity=0.55)
    pixels = placed(drawn.points) @ camera.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    if drawn.left:
        image = np.ascontiguousarray(image[:, ::-1])
        pixels[:, 0] = SIDE - pixels[:, 0]
    image = draw_landmarks(image, pixels)
    margin = np.full((SIDE, MARGIN, 3), 255, dtype=np.uint8)
    whole = np.ascontiguousarray(np.concatenate([margin, image], axis=1))
    _mark(whole, pixels + np.array([MARGIN, 0.0]), drawn.marks)
    _put(whole, text_strip(name, _LABEL), 4, SIDE - 2 * _LABEL)
    return whole


def _mark(
    image: Image,
    pixels: Float[np.ndarray, "landmark=21 2"],
    marks: dict[int, tuple[str, Colour]],
) -> None:
    """Draw a ring around joints, the bones that leave them, and their labels down the left side."""
    top = 4
    # Labels in the order of the joints' heights, so that few lines cross.
    for landmark in sorted(marks, key=lambda one: float(np.nan_to_num(pixels[one, 1]))):
        text, colour = marks[landmark]
        if not np.isfinite(pixels[landmark]).all():
            continue
        centre = (int(pixels[landmark, 0]), int(pixels[landmark, 1]))
        for child, parent in enumerate(LANDMARK_PARENTS):
            if parent == landmark and np.isfinite(pixels[child]).all():
                end = (int(pixels[child, 0]), int(pixels[child, 1]))
                cv2.line(image, centre, end, colour, 4, cv2.LINE_AA)
        cv2.circle(image, centre, 8, colour, 3, cv2.LINE_AA)
        strip = text_strip(text, _LABEL, warning=True)
        top = max(top, min(centre[1] - strip.shape[0] // 2, SIDE - 3 * _LABEL))
        end = (4 + strip.shape[1], top + strip.shape[0] // 2)
        cv2.line(image, centre, end, colour, 1, cv2.LINE_AA)
        _put(image, strip, 4, top)
        top += strip.shape[0] + 3


def _put(image: Image, strip: Image, left: int, top: int) -> None:
    rows, columns = min(strip.shape[0], SIDE - top), min(strip.shape[1], image.shape[1] - left)
    if rows > 0:
        image[top : top + rows, left : left + columns] = strip[:rows, :columns]
