"""A folder with the files that the documents name: photographs, landmarks, poses and hands of a reader."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]


def write_readers_folder(folder: Path) -> Path:
    """Write stand-ins for a reader's files, all made from the examples of the checkout.

    Args:
        folder: A folder that does not exist yet.
    """
    shutil.copytree(ROOT / "examples", folder / "examples")
    shutil.copy(folder / "examples" / "hands.json", folder / "landmarks.json")
    (folder / "K.json").write_text(json.dumps([[900.0, 0, 320], [0, 900.0, 240], [0, 0, 1]]))
    _write_photographs(folder)
    fitted = folder / "outputs" / "my_hands"
    run_command(f"fit examples/hands.json --output {fitted.relative_to(folder)}", folder)
    shutil.copy(fitted / "hands.json", folder / "hands.json")
    entries = json.loads((folder / "hands.json").read_text())
    points = np.array([entry["landmarks_3d"] for entry in entries if entry["landmarks_3d"]])
    np.save(folder / "poses.npy", points)
    (folder / "poses").mkdir()
    np.save(folder / "poses" / "session.npy", points)
    (folder / "pred.json").write_text(json.dumps([points.tolist(), []]))
    return folder


def _write_photographs(folder: Path) -> None:
    photo = folder / "examples" / "hand.jpg"
    shutil.copy(photo, folder / "photo.jpg")
    for name in ("photos", "my_photos", "more", "frames"):
        (folder / name).mkdir()
        shutil.copy(photo, folder / name / "000.jpg")
    pixels = cv2.imread(str(photo))
    assert pixels is not None
    height, width = pixels.shape[:2]
    clip = cv2.VideoWriter(
        str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (width, height)
    )
    for frame in range(8):
        moved = np.roll(pixels, frame, axis=1)
        clip.write(moved)
        cv2.imwrite(str(folder / "frames" / f"{frame:03d}.jpg"), moved)
    clip.release()


def run_command(command: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a command of `hand-recon` in a folder.

    Args:
        command: A verb and the words after it, as a document shows them.
        folder: The current folder of the command.
    """
    words = [sys.executable, "-m", "hand_recon", *command.split()]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
