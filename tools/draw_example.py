"""Draw `docs/images/example.jpg`: the example photographs with their hands.

python tools/draw_example.py
"""

from pathlib import Path

import cv2
import numpy as np

from hand_recon import reconstruct

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ("two_hands.jpg", "hand.jpg")
HEIGHT = 330
TARGET = ROOT / "docs" / "images" / "example.jpg"


def main() -> None:
    """Reconstruct the hands of each photograph, and put the drawings side by side at one height."""
    drawings = []
    for name in PHOTOS:
        drawing = reconstruct(ROOT / "examples" / name).draw()
        scale = HEIGHT / drawing.shape[0]
        drawings.append(cv2.resize(drawing, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    sheet = np.concatenate(drawings, axis=1)[..., ::-1]
    cv2.imwrite(str(TARGET), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f"{TARGET}: {TARGET.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
