"""Every reader of images, videos, networks, MANO and pickles from elsewhere, with a small valid file."""

import io
import pickle
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import torch
import yaml
from PIL import Image

from hand_recon.data.dexycb.files import SERIALS, read_intrinsics
from hand_recon.data.images import read_image
from hand_recon.data.landmarks.image_sizes import stored_size
from hand_recon.data.photos.photo import read_photo
from hand_recon.data.video.files import video_file
from hand_recon.data.video.sequences import Animation
from hand_recon.hand.mano.conversion import prepare_mano
from hand_recon.hand.mano.store import read_mano
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.backbones import build_backbone
from hand_recon.regressor.efficientnet_lite import efficientnet_lite0
from hand_recon.regressor.lifter_file import LifterSettings, save_lifter
from hand_recon.runs.audit.sources import Reading, read_given
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.lifters import load_named
from tests.support.file_readers import STEM, FileReader, zipped
from tests.support.mano_file import mano_arrays, mano_pickle, write_mano_folder
from tests.support.photo_checkpoint import LIFTER, write_run
from tests.support.video_files import write_clip

PIXELS: Final = np.random.default_rng(0).integers(0, 255, (40, 60, 3), dtype=np.uint8)


_hand = cache(open_hand)


def _image(suffix: str) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(PIXELS).save(stream, suffix)
    return stream.getvalue()


def _animation() -> bytes:
    stream = io.BytesIO()
    frames = [Image.fromarray(PIXELS), Image.fromarray(255 - PIXELS)]
    frames[0].save(stream, "GIF", save_all=True, append_images=frames[1:], duration=40)
    return stream.getvalue()


def _of_dataset(path: Path) -> object:
    """An image as training reads it; images that cannot be read are counted by their names."""
    image = read_image(path)
    if image is None:
        raise ValueError(f"{path}: skipped")
    return image


def _size(path: Path) -> object:
    """Size by the header alone; files without one are passed over."""
    stored_size.cache_clear()
    size = stored_size(path)
    if size is None:
        raise ValueError(f"{path}: passed over")
    return size


def _written(write: Callable[[Path], Path]) -> bytes:
    """Bytes of a file that a function writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        return write(Path(folder)).read_bytes()


@cache
def _checkpoint() -> bytes:
    return _written(lambda folder: write_run(folder / "run", *LIFTER) / "checkpoints" / "best.ckpt")


@cache
def _weights() -> bytes:
    stream = io.BytesIO()
    torch.save(efficientnet_lite0().state_dict(), stream)
    return stream.getvalue()


@cache
def _lifter() -> bytes:
    settings = LifterSettings(width=8, depth=1, iterations=1)

    def write(folder: Path) -> Path:
        save_lifter(folder / "a.safetensors", settings.build(open_hand()), settings, {})
        return folder / "a.safetensors"

    return _written(write)


@cache
def _mano(name: str) -> bytes:
    return _written(lambda folder: write_mano_folder(folder) / name)


@cache
def _mano_pickle() -> bytes:
    return mano_pickle(mano_arrays())


def _meta() -> bytes:
    return pickle.dumps({"handJoints3D": np.random.default_rng(1).normal(size=(21, 3))}, protocol=2)


def _intrinsics(path: Path) -> None:
    """Files of the other cameras."""
    for serial in SERIALS:
        other = path.with_name(f"{serial}_640x480.yml")
        if not other.exists():
            other.write_bytes(_camera())


def _camera() -> bytes:
    colour = {"fx": 600.5, "fy": 601.5, "ppx": 320.5, "ppy": 240.5}
    return yaml.safe_dump({"color": colour}).encode()


READERS: Final[dict[str, FileReader]] = {
    one.name: one
    for one in (
        *(
            FileReader(
                f"photograph, {form}", "binary", f"{STEM}.{form.lower()}",
                lambda form=form: _image(form), read_photo,  # type: ignore[misc]
            )
            for form in ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
        ),
        FileReader("image of a dataset", "binary", f"{STEM}.png", lambda: _image("PNG"), _of_dataset),
        FileReader("size of an image", "binary", f"{STEM}.jpg", lambda: _image("JPEG"), _size),
        FileReader("animation", "binary", f"{STEM}.gif", _animation, Animation),
        FileReader(
            "video", "binary", f"{STEM}.mp4",
            lambda: _written(lambda folder: write_clip(folder / "a.mp4", 3)), video_file,
        ),
        FileReader(
            "checkpoint", "binary", f"{STEM}.ckpt", _checkpoint, load_trained
        ),
        FileReader(
            "weights", "binary", f"{STEM}.pth", _weights,
            lambda path: build_backbone("efficientnet_lite0", str(path)),
        ),
        FileReader(
            "lifter", "binary", f"{STEM}.safetensors", _lifter,
            lambda path: load_named(str(path), _hand()),
        ),
        FileReader(
            "MANO, pickle", "binary", f"{STEM}.pkl", _mano_pickle,
            lambda path: prepare_mano(path, path.parent / "converted"),
        ),
        FileReader(
            "MANO, zip", "binary", f"{STEM}.zip", lambda: zipped("MANO_RIGHT.pkl", _mano_pickle()),
            lambda path: prepare_mano(path, path.parent / "converted"),
        ),
        FileReader(
            "MANO", "binary", f"{STEM}.safetensors", lambda: _mano("MANO_RIGHT.safetensors"), read_mano
        ),
        FileReader(
            "HO3D", "binary", f"{STEM}.pkl", _meta,
            lambda path: read_given([path], _hand(), None, Reading()),
        ),
        FileReader(
            "DexYCB", "yaml", f"{STEM}/calibration/intrinsics/{SERIALS[0]}_640x480.yml", _camera,
            lambda path: read_intrinsics(path.parents[2]), _intrinsics,
        ),
    )
}  # fmt: skip
"""Readers of images, videos and networks by name."""
