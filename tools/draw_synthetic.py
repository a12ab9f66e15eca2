"""Draw contact sheets of synthetic hands, one per level of difficulty."""

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from hand_recon.data.synthetic.gestures import gesture_library
from hand_recon.data.synthetic.levels import FEATURES, Level
from hand_recon.data.synthetic.painter import render_image
from hand_recon.data.synthetic.plausible import deepest_overlap
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import SyntheticHand, scene_surfaces, synthetic_hand
from hand_recon.data.synthetic.surface import merged
from hand_recon.data.synthetic.view import axis_rotation, sample_view
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import FINGERS, LANDMARK_PARENTS
from hand_recon.rendering.rays import RayScene

FINGER_COLOURS = ((230, 80, 60), (235, 180, 50), (80, 190, 90), (70, 140, 230), (170, 90, 210))
"""RGB, thumb to little finger."""


def tile(hand: SyntheticHand, side: int, *, landmarks: bool) -> np.ndarray:
    """Enlarge one image and draw its labels on it, with hollow circles for occluded landmarks."""
    size = len(hand.image)
    image = cv2.resize(hand.image, (side, side), interpolation=cv2.INTER_CUBIC)
    if not landmarks:
        return image
    points = np.nan_to_num(hand.landmarks_2d * side / size, nan=-100).round().astype(int)
    for child, parent in enumerate(LANDMARK_PARENTS):
        colour = FINGER_COLOURS[max(child - 1, 0) // 4 % len(FINGERS)]
        if parent >= 0 and hand.labelled[child] and hand.labelled[parent]:
            cv2.line(image, points[parent].tolist(), points[child].tolist(), colour, 1, cv2.LINE_AA)
        filled = -1 if not hand.occluded[child] else 1
        cv2.circle(image, points[child].tolist(), 3, colour, filled, cv2.LINE_AA)
    return image


def gesture_sheet(columns: int) -> np.ndarray:
    """Draw every gesture from the palm and from the thumb's side, with its name and overlap in mm."""
    level = Level("sheet", cone=0.0, roll=0.0, shift=0.0, sleeve=0.0)
    recipe = Recipe("train", level, 160, 0)
    model = open_hand(recipe.landmark_set)
    side = axis_rotation(np.array([0.0, 1.0, 0.0]), np.radians(75))
    tiles = []
    for gesture in gesture_library():
        angles = torch.from_numpy(gesture.joint_angles).float()
        hand = model(angles, torch.zeros(10))
        landmarks = hand.landmarks.numpy().astype(float)
        front = sample_view(recipe.random(0, "view"), level, recipe.crop_size, landmarks)
        from_the_side = replace(front, root_rotation=side @ front.root_rotation)
        pair = []
        for view in (front, from_the_side):
            surfaces = scene_surfaces(recipe, 0, hand, view)
            scene = RayScene(*merged(surfaces))
            pair.append(render_image(recipe, (0, 0), surfaces, scene, view.intrinsics)[0])
        image = np.ascontiguousarray(np.hstack(pair))
        overlap = deepest_overlap(landmarks) * 1000
        text = f"{gesture.name}{'*' if gesture.held_out else ''} {overlap:.0f}"
        cv2.putText(image, text, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(image)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    return np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])


def feature_sheet(level: str, split: str, crop_size: int, seed: int, columns: int) -> np.ndarray:
    """The same hands in every row, first with all features of a level, then without one each.

    Args:
        level: Name of the level.
        split: Split that the hands are of.
        crop_size: Side of the images, pixels.
        seed: Seed of the set.
        columns: Hands in a row.
    """
    rows = []
    for without in ((), *((feature,) for feature in FEATURES)):
        recipe = Recipe(split, level_named(level, without), crop_size, seed)
        hands = [synthetic_hand(recipe, index) for index in range(columns)]
        rows.append(np.hstack([tile(hand, 160, landmarks=False) for hand in hands]))
    return np.vstack(rows)


def main() -> None:
    """Write `<level>.png` or `gestures.png` into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--levels", nargs="+", default=["easy", "medium", "hard"])
    parser.add_argument("--gestures", action="store_true", help="draw the gesture library instead")
    parser.add_argument(
        "--features", action="store_true", help="a row per feature that images of a level lack"
    )
    parser.add_argument("--split", default="train")
    parser.add_argument("--crop-size", type=int, default=224)
    parser.add_argument("--rows", type=int, default=4)
    parser.add_argument("--columns", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.gestures:
        sheet = gesture_sheet(arguments.columns)
        cv2.imwrite(str(arguments.folder / "gestures.png"), sheet[..., ::-1])
        return
    for name in arguments.levels:
        if arguments.features:
            sheet = feature_sheet(
                name, arguments.split, arguments.crop_size, arguments.seed, arguments.columns
            )
            cv2.imwrite(str(arguments.folder / f"{name}-features.png"), sheet[..., ::-1])
            continue
        recipe = Recipe(arguments.split, level_named(name), arguments.crop_size, arguments.seed)
        hands = [synthetic_hand(recipe, i) for i in range(arguments.rows * arguments.columns)]
        tiles = [tile(hand, 224, landmarks=i % 2 == 1) for i, hand in enumerate(hands)]
        rows = [np.hstack(tiles[i :: arguments.rows]) for i in range(arguments.rows)]
        cv2.imwrite(str(arguments.folder / f"{name}.png"), np.vstack(rows)[..., ::-1])


if __name__ == "__main__":
    main()
