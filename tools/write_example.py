"""Write `examples/hands.json`: detected 2D landmarks of six hands, from synthetic views of the open hand.

python tools/write_example.py
"""

import json
from pathlib import Path
from typing import Any

from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import synthetic_view

TARGET = Path(__file__).resolve().parents[1] / "examples" / "hands.json"

VIEWS = ((2, "right"), (9, "right"), (14, "left"), (21, "right"), (33, "right"), (40, "left"))
"""Index and side of each view; a left hand is the mirror image of a right one."""

PLACES = (
    (40, 60, 1.4),
    (330, 40, 1.2),
    (180, 150, 1.5),
    (60, 190, 1.1),
    (400, 170, 1.0),
    (220, 30, 1.3),
)
"""Left, top and scale of each 224-pixel crop in an image of 640 × 480 pixels."""

HIDDEN = {3: (15, 16, 19, 20)}
"""Landmarks that the detector did not find, by hand."""


def main() -> None:
    """Write the file, one hand to a line."""
    recipe = Recipe("test", level_named("medium"), 224, 0, pictures=False)
    lines = [json.dumps(_hand(recipe, number)) for number in range(len(VIEWS))]
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def _hand(recipe: Recipe, number: int) -> dict[str, Any]:
    """One object of the file."""
    (index, side), (left, top, scale) = VIEWS[number], PLACES[number]
    view = synthetic_view(recipe, index)
    points: list[list[float] | None] = []
    for landmark, (u, v) in enumerate(view.landmarks_2d.tolist()):
        if landmark in HIDDEN.get(number, ()) or not view.labelled[landmark]:
            points.append(None)
            continue
        across = 224 - u if side == "left" else u
        confidence = round(float(view.confidence[landmark]), 2)
        points.append([round(left + scale * across, 1), round(top + scale * v, 1), confidence])
    return {"name": f"hand {number + 1}", "side": side, "landmarks": points}


if __name__ == "__main__":
    main()
