"""Pack photographs of hands with 2D landmarks, and what else a machine without network needs.

    PYTHONPATH=.:tools python -m gpu.pack labels.json --test test.json --images photos --out carried

Crops are those of `recipe=photos`: squares about the landmarks at expansion 1.5, left hands mirrored.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import UInt8

from gpu.packed import BACKBONE, HANDS, IN_3D, PackedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.dataset import HandDataset
from hand_recon.data.landmarks.exchanged import WithExchangedFingers
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from hand_recon.data.progress import with_progress
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import synthetic_hand
from hand_recon.regressor.efficientnet_lite import PACKAGE, imagenet_weights
from hand_recon.schema import HandSample

LIMIT_MIB: Final = 40
"""Largest file of crops that is written."""

MAYBE_MISSING: Final = {
    "jaxtyping": "shapes in annotations",
    "safetensors": "files of weights",
    "scipy": "distances on the hand's surface",
    "pillow": "reading crops",
    "torchvision": "backbones other than EfficientNet-Lite0",
    "opencv-python-headless": "rendered hands",
    "embreex": "rendered hands",
}
"""Packages that a machine with PyTorch and Lightning may lack, and what they are for."""


@dataclass(frozen=True)
class Encoding:
    """Size and quality of the stored crops."""

    size: int = 224
    """Side, pixels."""
    quality: int = 80
    """Quality of WebP, 1 to 100."""


@dataclass(frozen=True)
class Encoded:
    """One hand as it is stored."""

    sample: HandSample
    test: bool
    corner: tuple[int, int]
    content: bytes


def encode(pixels: UInt8[np.ndarray, "3 size size"], quality: int) -> tuple[tuple[int, int], bytes]:
    """Corner and encoded content of the part of a crop that is not exactly black.

    Args:
        pixels: RGB.
        quality: Quality of WebP, 1 to 100.
    """
    brightest = pixels.max(axis=0)
    rows, columns = (np.flatnonzero(brightest.max(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows = columns = np.array([0])
    top, left = int(rows[0]), int(columns[0])
    part = pixels[::-1, top : rows[-1] + 1, left : columns[-1] + 1].transpose(1, 2, 0)
    written = cv2.imencode(".webp", np.ascontiguousarray(part), [cv2.IMWRITE_WEBP_QUALITY, quality])
    return (left, top), written[1].tobytes()


def packed(encoded: list[Encoded], size: int, landmark_set: str) -> PackedHands:
    """Columns of encoded hands; 3D only if all have it.

    Raises:
        ValueError: There is no hand.
    """
    if not encoded:
        raise ValueError("There is no hand to pack; give a file of landmarks with images.")
    samples = [one.sample for one in encoded]
    in_3d = [one.landmarks_3d.numpy() for one in samples if one.landmarks_3d is not None]
    return PackedHands(
        size=size,
        landmark_set=landmark_set,
        names=tuple(one.source for one in samples),
        test=np.array([one.test for one in encoded]),
        landmarks_2d=np.stack([one.landmarks_2d.numpy() for one in samples]),
        corners=np.array([one.corner for one in encoded]),
        images=tuple(one.content for one in encoded),
        landmarks_3d=np.stack(in_3d) if len(in_3d) == len(samples) else None,
    )


def pack_labels(
    recipe: LandmarkRecipe, quality: int, landmark_set: str, exchanged: int = 0
) -> PackedHands:
    """Crops of the training, validation and test hands of landmark files; validation hands train here.

    Args:
        recipe: Files and crops.
        quality: Quality of WebP, 1 to 100.
        landmark_set: Landmark set of the labels.
        exchanged: Number of further training hands, with fingers of other hands.
    """
    splits = LandmarkSplits(recipe)
    encoded = []
    for split in ("train", "val", "test"):
        for sample in _samples(splits.dataset(split), split):
            corner, content = encode(sample.image.numpy(), quality)
            encoded.append(Encoded(sample, split == "test", corner, content))
    if exchanged:
        train = splits.dataset("train")
        with TemporaryDirectory() as folder:
            further = WithExchangedFingers(train, exchanged, Path(folder))
            for index in range(len(train), len(further)):
                sample = further[index]
                corner, content = encode(sample.image.numpy(), quality)
                encoded.append(Encoded(sample, False, corner, content))
    return packed(encoded, recipe.crop.size, landmark_set)


def _samples(dataset: HandDataset, split: str) -> Iterator[HandSample]:
    for index in with_progress(range(len(dataset)), len(dataset), f"Packing {split}"):
        sample = dataset[index]
        # A sample of another index replaces one that cannot be read.
        if sample.index == index:
            yield sample


def pack_rendered(level: str, count: int, encoding: Encoding, landmark_set: str) -> PackedHands:
    """Rendered test hands with 3D ground truth.

    Args:
        level: A key of `hand_recon.data.synthetic.levels.DIFFICULTIES`.
        count: Number of hands.
        encoding: Size and quality.
        landmark_set: Landmark set of the labels.
    """
    recipe = Recipe("test", level_named(level), encoding.size, 0, landmark_set)
    encoded = []
    for index in with_progress(range(count), count, "Rendering"):
        hand = synthetic_hand(recipe, index)
        sample = HandSample(
            image=torch.from_numpy(hand.image.transpose(2, 0, 1).copy()),
            landmarks_2d=torch.from_numpy(hand.landmarks_2d).float(),
            labelled=torch.from_numpy(hand.labelled),
            index=index,
            source=f"{level}/{index}",
            landmarks_3d=torch.from_numpy(hand.landmarks_3d).float(),
        )
        corner, content = encode(sample.image.numpy(), encoding.quality)
        encoded.append(Encoded(sample, True, corner, content))
    return packed(encoded, encoding.size, landmark_set)


def write_backbone(path: Path) -> None:
    """Write the ImageNet weights of EfficientNet-Lite0 in half precision, without the classifier."""
    torch.save({name: _halved(tensor) for name, tensor in imagenet_weights().items()}, path)


def _halved(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.half() if tensor.is_floating_point() else tensor


def main(words: list[str] | None = None) -> None:
    """Write the files, and say what is in them."""
    arguments = _parser().parse_args(words)
    torch.set_num_threads(1)
    encoding, out = Encoding(arguments.size, arguments.quality), arguments.out
    recipe = LandmarkRecipe(
        train=arguments.labels, test=arguments.test, images=arguments.images, side=arguments.side,
        crop=CropPolicy(encoding.size, "joints", arguments.expansion),
    )  # fmt: skip
    hands = pack_labels(recipe, encoding.quality, arguments.landmark_set, arguments.exchanged)
    hands.write(out / HANDS)
    _check_size(out / HANDS)
    print(
        f"{len(hands)} hands, {int(hands.test.sum())} of them for testing, {encoding.size} pixels"
    )
    if arguments.hands_in_3d:
        level, _, count = arguments.hands_in_3d.partition(":")
        pack_rendered(level, int(count or 500), encoding, hands.landmark_set).write(out / IN_3D)
    try:
        write_backbone(out / BACKBONE)
    except ModuleNotFoundError as error:
        print(f"No {BACKBONE}: {error}")
    _tell(out)


def _check_size(path: Path) -> None:
    mib = path.stat().st_size / 2**20
    if mib > LIMIT_MIB:
        raise SystemExit(
            f"{path} has {mib:.1f} MiB; expected at most {LIMIT_MIB}. Lower --quality or --size."
        )


def _tell(out: Path) -> None:
    """Print the sizes of the files, and what else to carry."""
    total = 0.0
    for path in sorted(out.iterdir()):
        total += path.stat().st_size / 2**20
        print(f"{path.stat().st_size / 2**20:8.1f} MiB  {path}")
    print(
        f"{total:8.1f} MiB  together. The images' licence holds for the crops: do not commit them."
    )
    print(
        f"Packages that the other machine may lack, as wheels (pip download --no-deps <name>), not {PACKAGE}:"
    )
    for name, use in MAYBE_MISSING.items():
        print(f"  {name}: {use}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("labels", type=Path, help="landmarks of the training images")
    parser.add_argument("--test", type=Path, help="landmarks of the test images; else a share")
    parser.add_argument("--images", type=Path, help="folder of the images, if not the labels' own")
    parser.add_argument("--out", type=Path, required=True, help="folder of the files to carry")
    parser.add_argument("--side", choices=("left", "right"), help="side of hands without one")
    parser.add_argument("--landmark-set", default="mediapipe", help="knuckle, mediapipe or mano")
    parser.add_argument("--size", type=int, default=Encoding.size, help="side of the crops")
    parser.add_argument("--quality", type=int, default=Encoding.quality, help="of WebP")
    parser.add_argument("--expansion", type=float, default=1.5, help="crop's side per box's")
    parser.add_argument(
        "--exchanged", type=int, default=0, help="further hands with fingers of other hands"
    )
    parser.add_argument("--hands-in-3d", metavar="LEVEL:COUNT", help="rendered test hands with 3D")
    return parser


if __name__ == "__main__":
    main()
