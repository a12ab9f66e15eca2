"""Optimize gestures of the library so that the thumb touches its target, on the mean hand.

Prints the new joint angles of each gesture in `TOUCHES`. Run it when the open hand changes, check the result
with `tools/draw_synthetic.py --gestures`, and copy the good rows into `gestures.yaml`.
"""

import argparse
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from hand_recon.data.synthetic.gestures import gesture_library
from hand_recon.data.synthetic.plausible import deepest_overlap
from hand_recon.data.synthetic.surface import vertex_normals
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED, FINGERS, LANDMARKS
from hand_recon.rendering.rays import RayScene

COMFORT = {"thumb CMC": (8.0, -6.0), "thumb MCP": (15.0, 0.0), "thumb IP": (18.0, 0.0)}
"""Bend and splay, degrees, that the thumb's joints are pulled towards: the middle of their easy range."""

TOUCHES: dict[str, tuple[str, ...]] = {
    "six": ("little pad",), "seven": ("ring pad",), "eight": ("middle pad",), "nine": ("index pad",),
    "zero": ("index pad",), "letter_o": ("index pad",),
    "letter_d": ("middle pad",), "letter_f": ("index pad",),
    "pinch_index": ("index pad",), "pinch_middle": ("middle pad",), "pinch_ring": ("ring pad",),
    "pinch_little": ("little pad",), "okay": ("index pad",), "tripod": ("index pad",),
    "three_tip": ("index pad",), "four_tip": ("index pad",),
    "five_tip": ("middle pad",),
    "pinch_flat": ("index pad",), "snap": ("middle pad",), "tea": ("index pad",),
    "ring_grip": ("index pad",), "writing": ("index pad",),
    "puppet": ("index pad",),
    "key": ("index side",), "lateral_tripod": ("index side",), "letter_t": ("index side",),
    "one": ("middle back",), "two": ("ring back",), "letter_u": ("ring back",),
    "letter_v": ("ring back",), "letter_h": ("ring back",), "three_fingers": ("little back",),
    "letter_w": ("little back",), "letter_i": ("index back",), "letter_s": ("index back",),
    "letter_x": ("middle back",), "point": ("middle back",), "fist": ("index back",),
    "horns": ("middle back",), "beckon": ("middle back",), "scissors": ("ring back",),
    "letter_a": ("index side",), "four": ("ring root",), "letter_b": ("ring root",),
}  # fmt: skip
"""Targets that the thumb's pad touches, by gesture."""


@dataclass(frozen=True)
class Spots:
    """Named places on the skin."""

    vertex: dict[str, int]
    """Index of the vertex, by name."""
    normals: Tensor
    """Normals of all vertices on the rest pose."""


def find_spots(model: HandModel) -> Spots:
    """Find pad, back, side and root of every finger on the rest pose."""
    vertices, joints = model.rest(torch.zeros(10))
    landmarks = model.landmarks_of(vertices, joints).numpy()
    surface, faces = vertices.numpy(), model.faces.numpy()
    scene = RayScene(surface, faces)
    found = {}
    for finger in FINGERS:
        names = [f"{finger} {part}" for part in ("MCP", "PIP", "DIP")]
        if finger == "thumb":
            names = ["thumb CMC", "thumb MCP", "thumb IP"]
        points = [landmarks[LANDMARKS.index(name)] for name in (*names, f"{finger} tip")]
        frames = [model.frames[ARTICULATED.index(name)].numpy() for name in names]
        last = points[2] + 0.8 * (points[3] - points[2])
        middle = points[1] + 0.5 * (points[2] - points[1])
        base = points[0] + 0.25 * (points[1] - points[0])
        rays = {
            "pad": (last, -frames[2][:, 1]), "back": (middle, frames[1][:, 1]),
            "side": (middle, frames[1][:, 2]), "root": (base, -frames[0][:, 1]),
        }  # fmt: skip
        for part, (origin, direction) in rays.items():
            hit = scene.nearest(origin[None], direction[None])
            spot = origin + hit.distance[0] * direction
            found[f"{finger} {part}"] = int(np.linalg.norm(surface - spot, axis=1).argmin())
    return Spots(found, torch.from_numpy(vertex_normals(surface, faces)).float())


def touch(model: HandModel, spots: Spots, name: str, start: Tensor) -> tuple[Tensor, float]:
    """Find joint angles near the start at which the thumb's pad touches its targets.

    Returns:
        Joint angles, radians, and the gap that is left, metres.
    """
    targets = TOUCHES[name]
    free = torch.zeros(15, 3)
    for joint in COMFORT:
        free[ARTICULATED.index(joint), 0] = 1
    free[ARTICULATED.index("thumb CMC"), 1] = 1
    comfort = start.clone()
    for joint, (bend, splay) in COMFORT.items():
        comfort[ARTICULATED.index(joint), :2] = torch.tensor([bend, splay]).deg2rad()
    for target in targets:
        finger, part = target.split()
        if part == "pad":
            for joint, share in (("MCP", 1.0), ("PIP", 1.0), ("DIP", 0.6)):
                free[ARTICULATED.index(f"{finger} {joint}"), 0] = share
    change = torch.zeros(15, 3, requires_grad=True)
    optimiser = torch.optim.Adam([change], lr=0.02)
    for _ in range(350):
        angles = start + free * change
        loss, gap = _cost(model, spots, targets, angles)
        away = (angles - comfort) * (free > 0)
        loss = (
            loss
            + 4e-5 * away.square().sum()
            + 5e-4 * (0.05 - angles[:, 0]).clamp(min=0)[[1, 2, 4, 5, 7, 8, 10, 11]].square().sum()
        )
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return (start + free * change).detach(), gap.item()


def _cost(
    model: HandModel, spots: Spots, targets: tuple[str, ...], angles: Tensor
) -> tuple[Tensor, Tensor]:
    hand = model(angles, torch.zeros(10))
    thumb = hand.vertices[spots.vertex["thumb pad"]]
    normal = _normal(hand.vertices, model.faces, spots.vertex["thumb pad"])
    # With two targets, the thumb touches the point between them.
    ends = [hand.vertices[spots.vertex[target]] for target in targets]
    normals = [_normal(hand.vertices, model.faces, spots.vertex[target]) for target in targets]
    centre, mean = torch.stack(ends).mean(0), torch.stack(normals).mean(0)
    together = torch.stack(ends).sub(centre).square().sum() * 0.3
    gap = (thumb - centre - 0.0005 * mean).square().sum()
    facing = (0.8 + (normal * mean).sum()).clamp(min=0)
    return gap + together + 6e-5 * facing, (thumb - centre).norm()


def _normal(vertices: Tensor, faces: Tensor, vertex: int) -> Tensor:
    around = vertices[faces[(faces == vertex).any(dim=1)]]
    normal = torch.linalg.cross(around[:, 1] - around[:, 0], around[:, 2] - around[:, 0]).sum(0)
    return normal / normal.norm()


def main() -> None:
    """Print every gesture of `TOUCHES` with its angles in degrees, and gap and overlap in millimetres."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    names = parser.parse_args().names
    torch.set_num_threads(1)
    model = open_hand()
    spots = find_spots(model)
    for gesture in gesture_library():
        if gesture.name not in TOUCHES or (names and gesture.name not in names):
            continue
        angles, gap = touch(
            model, spots, gesture.name, torch.from_numpy(gesture.joint_angles).float()
        )
        overlap = deepest_overlap(model(angles, torch.zeros(10)).landmarks.numpy())
        degrees = angles.rad2deg().round().int().tolist()
        thumb = [degrees[12][0], degrees[12][1], degrees[13][0], degrees[14][0]]
        fingers = {
            finger: [
                degrees[ARTICULATED.index(f"{finger} {joint}")][0]
                for joint in ("MCP", "PIP", "DIP")
            ]
            for finger in FINGERS[1:]
            if f"{finger} pad" in TOUCHES[gesture.name]
        }
        print(
            f"{gesture.name} | {thumb} | {fingers} | gap {gap * 1000:.1f} overlap {overlap * 1000:.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
