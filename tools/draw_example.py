"""Draw `docs/images/example.png`: the first four hands of `examples/hands.json`, fitted.

python tools/draw_example.py
"""

import tempfile
from pathlib import Path

import cv2

from hand_recon import fit_landmarks, read_landmarks

ROOT = Path(__file__).resolve().parents[1]
HANDS = 4
TARGET = ROOT / "docs" / "images" / "example.png"


def main() -> None:
    """Fit the hands and keep the sheet at half its size."""
    landmarks = read_landmarks(ROOT / "examples" / "hands.json").select(slice(0, HANDS))
    with tempfile.TemporaryDirectory() as folder:
        sheet = cv2.imread(str(fit_landmarks(landmarks).draw(Path(folder) / "sheet.png")))
    if sheet is None:
        raise FileNotFoundError("The fit left no sheet.")
    small = cv2.resize(sheet, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(TARGET), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{TARGET}: {TARGET.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
