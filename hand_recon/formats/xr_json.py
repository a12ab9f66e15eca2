"""Hand joints of OpenXR, WebXR and Unity as JSON, one file for a scene.

    {"format": "OpenXR hand joints", "version": 1, "space": …, "joints": [26 names], "estimated": [names],
     "hands": [{"hand": 1, "side": "left", "radii": [26],
                "frames": [{"frame": 0, "time": 0.0, "is_active": true, "seen": true,
                            "positions": [26 × [x, y, z]], "orientations": [26 × [x, y, z, w]]}, …]}, …]}

Every hand has an entry for each frame of its scene that has a hand; where this hand is missing, `is_active`
is false and the entry ends there, as a device gives all joints of a hand or none. OpenXR's and WebXR's space
has x to the right, y up and z towards the viewer; Unity's is left-handed, with z forward.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.formats.exported_hands import ExportedHand, Scene
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.new_file import write_new
from hand_recon.formats.xr_joints import ESTIMATED, XR_JOINTS, xr_motion
from hand_recon.hand.model import HandModel

_DECIMALS: Final = {"positions": 6, "orientations": 7, "radii": 5, "time": 6}


@dataclass(frozen=True)
class XrFlavour:
    """Names, order and axes that a program wants."""

    title: str
    """Value of `format`."""
    space: str
    """Value of `space`."""
    names: dict[str, str]
    """Name of each joint by its name in `XR_JOINTS`, in the program's order."""
    position_signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors of x, y and z from OpenXR's space."""
    orientation_signs: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Factors of a quaternion's x, y, z and w from OpenXR's."""


_RIGHT_HANDED: Final = (
    "metres; right-handed: x right, y up, z back; origin at the camera, which looks along -z"
)


def _of_webxr(name: str) -> str:
    """Name of a joint in the WebXR Hand Input Module."""
    if name == "WRIST":
        return "wrist"
    finger, part = name.lower().split("_")
    bone = part if part in {"metacarpal", "tip"} else f"phalanx-{part}"
    named = {"thumb": "thumb", "little": "pinky-finger"}.get(finger, f"{finger}-finger")
    return f"{named}-{bone}"


def _of_unity(name: str) -> str:
    """Name of a joint in Unity's `XRHandJointID`."""
    return "".join(word.capitalize() for word in name.split("_"))


OPENXR: Final = XrFlavour(
    "OpenXR hand joints", _RIGHT_HANDED, {name: f"XR_HAND_JOINT_{name}_EXT" for name in XR_JOINTS}
)
"""`XR_EXT_hand_tracking`: 26 joints, the palm first."""

WEBXR: Final = XrFlavour(
    "WebXR hand joints", _RIGHT_HANDED, {name: _of_webxr(name) for name in XR_JOINTS[1:]}
)
"""WebXR Hand Input: 25 joints, without the palm."""

UNITY: Final = XrFlavour(
    "Unity XR hand joints",
    "metres; left-handed: x right, y up, z forward; origin at the camera, which looks along +z",
    {name: _of_unity(name) for name in ("WRIST", "PALM", *XR_JOINTS[2:])},
    (1.0, 1.0, -1.0),
    (-1.0, -1.0, 1.0, 1.0),
)
"""Unity's XR Hands: 26 joints, the wrist first, in a left-handed space."""


def write_xr_json(path: str | Path, scene: Scene, hand: HandModel, flavour: XrFlavour) -> Path:
    """Write the joints of the hands of a scene, a line for each frame of a hand; folders are made.

    Args:
        path: File to write.
        scene: The hands.
        hand: Model of the right hand.
        flavour: Names, order and axes.

    Raises:
        FileExistsError: The file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions(scene.trajectories)
    head = {
        "format": flavour.title,
        "version": 1,
        "space": flavour.space,
        "joints": list(flavour.names.values()),
        "estimated": [flavour.names[name] for name in ESTIMATED if name in flavour.names],
    }
    hands = ",\n".join(_hand(one, scene, hand, flavour) for one in scene.hands)
    return write_new(path, f'{json.dumps(head)[:-1]}, "hands": [\n{hands}\n]}}\n'.encode())


def _hand(one: ExportedHand, scene: Scene, hand: HandModel, flavour: XrFlavour) -> str:
    """One hand as JSON, its frames on lines of their own."""
    motion = xr_motion(one.trajectory, hand)
    order = [XR_JOINTS.index(name) for name in flavour.names]
    head = {
        "hand": one.trajectory.hand,
        "side": one.trajectory.side,
        "radii": _rounded(motion.radii[order], "radii"),
    }
    positions = motion.positions[:, order] * flavour.position_signs
    orientations = motion.orientations[:, order] * flavour.orientation_signs
    lines = ",\n".join(map(json.dumps, _frames(one, scene, positions, orientations)))
    return f'{json.dumps(head)[:-1]}, "frames": [\n{lines}\n]}}'


def _frames(
    one: ExportedHand,
    scene: Scene,
    positions: Float[np.ndarray, "frame joint 3"],
    orientations: Float[np.ndarray, "frame joint 4"],
) -> Iterator[dict[str, Any]]:
    rows = {frame: row for row, frame in enumerate(one.trajectory.frames.tolist())}
    for frame, time in scene.frames.items():
        entry: dict[str, Any] = {
            "frame": frame,
            "time": round(time, _DECIMALS["time"]),
            "is_active": frame in rows,
        }
        if frame in rows:
            row = rows[frame]
            entry["seen"] = bool(one.trajectory.observed[row])
            entry["positions"] = _rounded(positions[row], "positions")
            entry["orientations"] = _rounded(orientations[row], "orientations")
        yield entry


def _rounded(values: Float[np.ndarray, "..."], key: str) -> list[Any]:
    # Adding zero turns −0 into 0.
    rounded: list[Any] = (values.round(_DECIMALS[key]) + 0.0).tolist()
    return rounded
