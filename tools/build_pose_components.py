"""Build `hand_recon/knowledge/tables/pose_components.npz`: a PCA of the training gestures.

    python tools/build_pose_components.py

Every run writes the same file. Standard deviations below two degrees are raised to two: mixtures of gestures
never twist a finger, but real hands do, and the prior must not forbid what only the sampler lacks.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.knowledge import pose_components

POSES = 20_000
"""Number of sampled poses."""

LEAST = np.radians(2.0)
"""Least standard deviation of a component, radians."""


def tables(poses: int = POSES) -> dict[str, Float[np.ndarray, "..."]]:
    """Compute the file's arrays: mean pose, components by decreasing variance, their standard deviations."""
    random = np.random.Generator(np.random.PCG64(0))
    angles = np.stack([sample_pose(random).ravel() for _ in range(poses)])
    mean = angles.mean(axis=0)
    _, singular_values, components = np.linalg.svd(angles - mean, full_matrices=False)
    deviations = np.maximum(singular_values / np.sqrt(poses - 1), LEAST)
    found = {"mean": mean, "components": components, "deviations": deviations}
    return {name: values.astype(np.float32) for name, values in found.items()}


def main() -> None:
    """Sample poses, compute their PCA, write the file."""
    built = tables()
    path = Path(pose_components.__file__).parent / pose_components.TABLE
    with path.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **built)
    kept = (built["deviations"] > LEAST).sum()
    print(f"{path}: {POSES} poses, {kept} components vary by more than {np.degrees(LEAST):.0f}°.")


if __name__ == "__main__":
    main()
