"""Hands before a browser's webcam, image by image, each fitted from the one before."""

import io
import time
import warnings
from typing import Any, Final

import numpy as np
from jaxtyping import UInt8
from omegaconf import DictConfig
from PIL import Image

from hand_recon.detection.detector import Detector
from hand_recon.detection.tracking import TrackerState
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.page.bounds import Bounds
from hand_recon.page.hand_views import hands_view
from hand_recon.page.row_fits import PosedRecords
from hand_recon.runs.clip.checks import check_clip
from hand_recon.runs.clip.finding import follower
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.live_hands import LiveHands
from hand_recon.runs.clip.options import MotionOptions
from hand_recon.runs.clip.smoothed import ClipPoses
from hand_recon.runs.configuration import instantiate
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_objective
from hand_recon.runs.looking import steps_before

NAME: Final = "webcam"
"""Name of the source in results."""


class LiveView:
    """One webcam: the tracker's state, the hands that are followed, and their smoothing.

    Args:
        config: `conf/predict.yaml` composed and adapted, with the page's detector and hand.
        hand: The hand model.
        detector: Finds the hands.
        ranges: Ranges of motion, one set for all hands.

    Raises:
        ValueError: The detector looks hands up by file, or another option is for photographs.
    """

    def __init__(
        self, config: DictConfig, hand: HandModel, detector: Detector, ranges: RangeOfMotion
    ) -> None:
        check_clip(config)
        options: MotionOptions = instantiate(config.motion)
        self.follow = follower(detector, options.palms_every, options.copies)
        self.state, self.number, self.ranges = TrackerState(), 0, ranges
        self.start = time.monotonic()
        origin = source_of(config, hand, steps_before(detector, None))
        choice = parse_camera(str(config.camera), 1)
        self.live = LiveHands(config, choice, origin, options.live_smoothing)
        self.poses = ClipPoses(
            build_objective(config, hand),
            instantiate(config.descent),
            config.sigma_at_half_confidence,
            with_covariance=False,
        )

    def __call__(self, pixels: UInt8[np.ndarray, "height width 3"]) -> dict[str, Any]:
        """Find and pose the hands of the next image.

        Args:
            pixels: RGB, not mirrored.

        Returns:
            The image's width and height, its hands, and the milliseconds that they took.
        """
        begun = time.monotonic()
        detections, self.state = self.follow(pixels, self.state)
        height, width, _ = pixels.shape
        frame = FoundFrame(
            self.number, begun - self.start, (width, height), detections.hands, self.state
        )
        self.number += 1
        hands = []
        for smoothed in self.live(frame, NAME):
            records, vertices = self.poses(smoothed, np.arange(len(smoothed.motion)))
            hands += hands_view(PosedRecords(records, vertices), self.ranges)
        return {
            "size": [width, height],
            "hands": hands,
            "found": len(detections.hands),
            "milliseconds": round(1000 * (time.monotonic() - begun), 1),
        }


def decoded_image(content: bytes, bounds: Bounds) -> UInt8[np.ndarray, "height width 3"]:
    """Decode a JPEG image of a webcam.

    Args:
        content: The file's bytes.
        bounds: Most pixels.

    Raises:
        ValueError: It is no JPEG image, or has too many pixels.
    """
    most = f"expected at most {bounds.frame_pixels / 1e6:.1f} megapixels. Send a smaller one."
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content), formats=["JPEG"]) as image:
                width, height = image.size
                if width * height > bounds.frame_pixels:
                    raise ValueError(f"The webcam's image has {width} × {height} pixels; {most}")
                return np.array(image.convert("RGB"))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise ValueError(f"The webcam's image has more pixels than Pillow opens; {most}") from error
    except (OSError, SyntaxError) as error:
        raise ValueError(
            f"The webcam's image, {len(content)} bytes, is no whole JPEG image. Send the next one."
        ) from error
