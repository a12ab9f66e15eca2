"""Build the open hand's asset from the body model's CC0 data: `python tools/build_open_hand.py`.

Needs the `assets` extra. Runs with the same package versions give the same file, bit for bit.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from jaxtyping import Float

from open_hand.closest import distances
from open_hand.decimation import Decimation, decimate
from open_hand.landmarks import knuckle_landmarks, mano_landmarks
from open_hand.shape import ShapeDirections, shape_directions
from open_hand.skeleton import ORDER, build_skeleton, tip_vertex
from open_hand.skinning import skinning_weights
from open_hand.source import SourceHand, boundary_ring, load_source

ASSET = Path(__file__).resolve().parents[1] / "hand_recon" / "hand" / "assets" / "open_hand.npz"

COUNTS = (778, 16)
"""Vertices of the mesh and of its boundary at the wrist, as in MANO, which has the same 1,538 faces."""

GRID = 2**20
"""Grid points per metre for the surface and its shape directions."""


def build(source: SourceHand) -> dict[str, np.ndarray]:
    """Build the arrays of the hand's file, by the names of `HandAsset`'s fields."""
    skeleton = build_skeleton(source)
    weights = skinning_weights(source, skeleton)
    shape = shape_directions(source, skeleton, weights)
    pinned = [tip_vertex(source, finger) for finger in ORDER]
    coarse = decimate(source.vertices, source.faces, COUNTS, pinned)
    report(source, coarse, shape)
    coarse_weights = strongest_four(coarse.barycentric @ weights)
    return {
        "template": coarse.vertices,
        "shape_directions": np.einsum("cv,vxs->cxs", coarse.barycentric, shape.vertices),
        "joints": skeleton.joints,
        "joint_shape_directions": shape.joints,
        "skinning_weights": coarse_weights,
        "faces": coarse.faces,
        "wrist_ring": boundary_ring(coarse.faces),
        "frames": skeleton.frames,
        "rest_angles": skeleton.rest_angles,
        "landmarks_knuckle": knuckle_landmarks(coarse.vertices, coarse_weights, skeleton),
        "landmarks_mano": mano_landmarks(coarse.vertices, coarse_weights, source, skeleton),
    }


def strongest_four(
    weights: Float[np.ndarray, "vertex joint=16"],
) -> Float[np.ndarray, "vertex joint=16"]:
    """Keep the four largest weights of each vertex, normalized to a sum of one."""
    weakest = np.sort(weights, axis=1)[:, -4, None]
    kept = np.where((weights < weakest) | (weights < 5e-3), 0.0, weights)
    return np.asarray(kept / kept.sum(axis=1, keepdims=True))


def report(source: SourceHand, coarse: Decimation, shape: ShapeDirections) -> None:
    """Print the error of the decimation, and lengths and correlations of the shape directions."""
    samples = source.vertices[source.faces].mean(axis=1)
    away = 1e3 * distances(samples, coarse.vertices, coarse.faces)
    sys.stdout.write(
        f"{len(source.vertices)} → {len(coarse.vertices)} vertices, {len(coarse.faces)} faces; the "
        f"source's faces are {away.mean():.3f} mm away on average, at most {away.max():.2f} mm.\n"
    )
    flat = shape.vertices.reshape(-1, 10)
    gram = flat.T @ flat
    lengths = np.sqrt(np.diag(gram))
    worst = np.abs(gram / np.outer(lengths, lengths) - np.eye(10)).max()
    for name, rms in zip(shape.names, 1e3 * lengths / np.sqrt(len(shape.vertices)), strict=True):
        sys.stdout.write(f"  {name}: {rms:.2f} mm RMS per standard deviation\n")
    sys.stdout.write(f"Largest correlation between two shape directions: {worst:.3f}\n")


def save(arrays: dict[str, np.ndarray], path: Path) -> None:
    """Write the file in single precision with 16-bit indices, replacing an old one atomically."""
    small = {name: array.astype(np.float32) for name, array in arrays.items()}
    for name in ("faces", "wrist_ring"):
        small[name] = arrays[name].astype(np.int16)
    for name in ("template", "shape_directions"):
        # Rounding to about a micrometre halves the compressed size.
        small[name] = (np.round(arrays[name] * GRID) / GRID).astype(np.float32)
    temporary = path.with_suffix(".tmp.npz")
    np.savez_compressed(temporary, allow_pickle=False, **small)
    os.replace(temporary, path)
    sys.stdout.write(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB\n")


def main() -> None:
    """Build the hand and write its file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ASSET, help="where to write the asset")
    save(build(load_source()), parser.parse_args().out)


if __name__ == "__main__":
    main()
