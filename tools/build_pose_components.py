"""Build `hand_recon/knowledge/tables/pose_components.npz`: a PCA of the training gestures.

    python tools/build_pose_components.py

The same file on every run. What varies less than two degrees is held to two: mixtures of gestures never twist
a finger, and a prior that forbade it outright would have learnt that from a sampler and not from hands.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.knowledge import pose_components

POSES = 20_000
LEAST = np.radians(2.0)


def tables(poses: int = POSES) -> dict[str, Float[np.ndarray, "..."]]:
    """What the file holds: the mean pose, the components by decreasing spread, and their deviations."""
    random = np.random.Generator(np.random.PCG64(0))
    angles = np.stack([sample_pose(random).ravel() for _ in range(poses)])
    mean = angles.mean(axis=0)
    _, spread, components = np.linalg.svd(angles - mean, full_matrices=False)
    deviations = np.maximum(spread / np.sqrt(poses - 1), LEAST)
    found = {"mean": mean, "components": components, "deviations": deviations}
    return {name: values.astype(np.float32) for name, values in found.items()}


def main() -> None:
    """Sample, decompose, write."""
    built = tables()
    path = Path(pose_components.__file__).parent / pose_components.TABLE
    with path.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **built)
    kept = (built["deviations"] > LEAST).sum()
    print(f"{path}: {POSES} poses, {kept} components vary by more than {np.degrees(LEAST):.0f}°.")


if __name__ == "__main__":
    main()
