"""Draw `docs/images/example.jpg`: the example photographs with their hands.

python tools/draw_example.py
"""

from pathlib import Path

import cv2
import numpy as np

from hand_recon import reconstruct
from hand_recon.data.photos import read_photo

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ("two_hands.jpg", "hand.jpg")
HEIGHT = 330
TARGET = ROOT / "docs" / "images" / "example.jpg"


def main() -> None:
    """Reconstruct the hands of each photograph, and put the drawings side by side at one height."""
    drawings = []
    for name in PHOTOS:
        pixels = read_photo(ROOT / "examples" / name).pixels
        # A drawing has its photograph's resolution, which is too low for lines in one of 100 pixels.
        larger = max(1.0, HEIGHT / max(pixels.shape))
        pixels = cv2.resize(pixels, None, fx=larger, fy=larger, interpolation=cv2.INTER_CUBIC)
        drawing = reconstruct(pixels).draw()
        scale = HEIGHT / drawing.shape[0]
        drawings.append(cv2.resize(drawing, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    sheet = np.concatenate(drawings, axis=1)[..., ::-1]
    cv2.imwrite(str(TARGET), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f"{TARGET}: {TARGET.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
