"""The tools' formats, told apart by their content."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon.data.landmarks.coco import is_coco, parse_coco
from hand_recon.data.landmarks.formats.label_studio import is_label_studio, parse_label_studio
from hand_recon.data.landmarks.formats.labelme import is_labelme, parse_labelme
from hand_recon.data.landmarks.formats.mediapipe import is_mediapipe, parse_mediapipe
from hand_recon.data.landmarks.formats.mmpose import is_mmpose, parse_mmpose
from hand_recon.data.landmarks.formats.openpose import is_openpose, parse_openpose
from hand_recon.data.landmarks.formats.ultralytics import is_ultralytics, parse_ultralytics
from hand_recon.data.landmarks.parsed import ParsedHands


@dataclass(frozen=True)
class JsonFormat:
    """A tool's JSON format."""

    name: str
    """Name of the tool."""
    is_content: Callable[[object], bool]
    """True for content of this format."""
    parse: Callable[[Path, Any], ParsedHands]
    """Reads the hands of such content; raises ValueError for what is wrong in it."""


JSON_FORMATS: Final = (
    JsonFormat("OpenPose", is_openpose, parse_openpose),
    JsonFormat("LabelMe", is_labelme, parse_labelme),
    JsonFormat("Label Studio", is_label_studio, parse_label_studio),
    JsonFormat("MediaPipe", is_mediapipe, parse_mediapipe),
    JsonFormat("mmpose", is_mmpose, parse_mmpose),
    JsonFormat("Ultralytics", is_ultralytics, parse_ultralytics),
    JsonFormat("COCO", is_coco, parse_coco),
)
"""All formats in the order in which they are tried; COCO's is the least specific."""


def json_format_of(content: object) -> JsonFormat | None:
    """The format of JSON content; None for the project's own forms, and for what is none."""
    return next((form for form in JSON_FORMATS if form.is_content(content)), None)
