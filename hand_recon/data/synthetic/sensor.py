"""Camera simulation: exposure, white balance, blur, noise and JPEG compression."""

from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.data.synthetic.levels import Level

_GAMMA: Final = 1 / 2.2


def develop(
    random: np.random.Generator, level: Level, light: Float[np.ndarray, "3 height width"]
) -> UInt8[np.ndarray, "height width 3"]:
    """Convert linear light to an sRGB photograph with the level's blur, noise and compression.

    Args:
        random: Source of randomness.
        level: Level with the largest blur, motion and noise, and the JPEG qualities.
        light: Linear light, about 0–1.
    """
    scale = light.shape[1] / REFERENCE_SIZE
    balance = np.exp(random.normal(scale=0.04, size=3) + random.normal(scale=0.12))
    image: np.ndarray = np.empty((*light.shape[1:], 3), dtype=np.float32)
    for channel in range(3):
        image[..., channel] = light[channel] * balance[channel]
    blur = random.uniform(0, level.blur) * scale
    if blur > 0.15:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    image = _motion_blurred(random, image, random.uniform(0, level.motion) * scale)
    deviation = random.uniform(0.2, 1.0) * level.sensor_noise
    grain = random.standard_normal(image.shape, dtype=np.float32)
    # Shot noise grows with the square root of light, so it is uniform after the gamma curve.
    shown = np.clip(image, 0, 1, out=image)
    shown **= np.float32(_GAMMA * random.uniform(0.9, 1.1))
    grain *= np.float32(deviation)
    shown += grain
    np.clip(shown, 0, 1, out=shown)
    shown *= 255
    shown += 0.5
    return _compressed(shown.astype(np.uint8), int(random.integers(*level.jpeg_quality)))


def _motion_blurred(
    random: np.random.Generator, image: Float[np.ndarray, "height width 3"], length: float
) -> Float[np.ndarray, "height width 3"]:
    """Blur along a random direction; below a length of one pixel the image is unchanged."""
    angle = random.uniform(0, np.pi)
    if length < 1:
        return image
    side = 2 * int(np.ceil(length / 2)) + 1
    kernel = np.zeros((side, side), dtype=np.float32)
    reach = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    start, end = side // 2 - reach, side // 2 + reach
    cv2.line(kernel, [int(v) for v in np.rint(start)], [int(v) for v in np.rint(end)], 1.0, 1)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()))


def _compressed(
    pixels: UInt8[np.ndarray, "height width 3"], quality: int
) -> UInt8[np.ndarray, "height width 3"]:
    """Encode as JPEG and decode; the order of channels does not matter for the round trip."""
    _, code = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), dtype=np.uint8)
