"""Reader of BVH files, with forward kinematics."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

_AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass
class BvhJoint:
    """A joint or an end site."""

    name: str
    parent: int
    offset: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    channels: list[str] = field(default_factory=list)


class BvhReader:
    """A BVH file: its skeleton in the file's order, and its motion."""

    def __init__(self, text: str) -> None:
        lines = [line.strip() for line in text.splitlines()]
        motion = lines.index("MOTION")
        assert lines[0] == "HIERARCHY"
        self.joints: list[BvhJoint] = []
        self._read_hierarchy(lines[1:motion])
        # The two lines must follow at once.
        frames, frame_time = lines[motion + 1], lines[motion + 2]
        assert frames.startswith("Frames: ")
        assert frame_time.startswith("Frame Time: ")
        self.frame_time = float(frame_time.split(": ")[1])
        self.values = np.array(
            [[float(value) for value in line.split()] for line in lines[motion + 3 :]]
        )
        assert len(self.values) == int(frames.split(": ")[1])
        assert self.values.shape[1] == sum(len(joint.channels) for joint in self.joints)

    def _read_hierarchy(self, lines: list[str]) -> None:
        open_joints: list[int] = []
        for line in lines:
            words = line.split()
            if words[0] in ("ROOT", "JOINT", "End"):
                name = words[1] if words[0] != "End" else f"{self.joints[open_joints[-1]].name} end"
                assert len(words) == 2
                self.joints.append(BvhJoint(name, open_joints[-1] if open_joints else -1))
                latest = len(self.joints) - 1
            elif words[0] == "{":
                open_joints.append(latest)
            elif words[0] == "}":
                open_joints.pop()
            elif words[0] == "OFFSET":
                self.joints[open_joints[-1]].offset = np.array([float(word) for word in words[1:]])
            else:
                assert words[0] == "CHANNELS"
                assert len(words) == 2 + int(words[1])
                self.joints[open_joints[-1]].channels = words[2:]
        assert not open_joints

    def positions(self, values: Float[np.ndarray, " channel"]) -> dict[str, Float[np.ndarray, "3"]]:
        """Positions of all joints and end sites at one frame's values."""
        rotations: list[np.ndarray] = []
        places: list[np.ndarray] = []
        column = 0
        for joint in self.joints:
            place, rotation = joint.offset.copy(), np.eye(3)
            for channel in joint.channels:
                axis, value = _AXES[channel[0]], values[column]
                column += 1
                if channel.endswith("position"):
                    place[axis] += value
                else:
                    rotation = rotation @ _about(axis, np.radians(value))
            if joint.parent >= 0:
                place = places[joint.parent] + rotations[joint.parent] @ place
                rotation = rotations[joint.parent] @ rotation
            places.append(place)
            rotations.append(rotation)
        return {joint.name: place for joint, place in zip(self.joints, places, strict=True)}


def _about(axis: int, angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about a coordinate axis, right-handed."""
    second, third = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[second, second] = matrix[third, third] = np.cos(angle)
    matrix[third, second], matrix[second, third] = np.sin(angle), -np.sin(angle)
    return matrix
