"""Draw `docs/images/fits.png`: the first test views, fitted as `python -m hand_recon.fit` fits any landmarks.

python tools/draw_fits.py
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import synthetic_view

HANDS = 4
TARGET = Path(__file__).parents[1] / "docs" / "images" / "fits.png"


def main() -> None:
    """Write the landmarks, fit them, keep the contact sheet."""
    recipe = Recipe("test", level_named("hard"), 224, 0, pictures=False)
    views = [synthetic_view(recipe, index) for index in range(HANDS)]
    hands = [
        [
            [float(u), float(v), float(sure)] if there else None
            for (u, v), sure, there in zip(
                view.landmarks_2d, view.confidence, view.labelled, strict=True
            )
        ]
        for view in views
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hands.json").write_text(json.dumps(hands), encoding="utf-8")
        command = [sys.executable, "-m", "hand_recon.fit", f"landmarks={folder / 'hands.json'}"]
        subprocess.run([*command, f"output={folder / 'out'}"], check=True)  # noqa: S603
        sheet = cv2.imread(str(folder / "out" / "fits.png"))
    if sheet is None:
        raise FileNotFoundError("The fit left no fits.png.")
    small = cv2.resize(sheet, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(TARGET), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{TARGET}: {TARGET.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
