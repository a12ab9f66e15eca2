"""Build `hand_recon/knowledge/tables/pose_components.npz`: a PCA of the training gestures.

    python tools/build_pose_components.py

The same file on every run. What varies less than two degrees is held to two: mixtures of gestures never twist
a finger, and a prior that forbade it outright would have learnt that from a sampler and not from hands.
"""

from pathlib import Path

import numpy as np

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.knowledge import pose_components

POSES = 20_000
LEAST = np.radians(2.0)


def main() -> None:
    """Sample, decompose, write."""
    random = np.random.Generator(np.random.PCG64(0))
    poses = np.stack([sample_pose(random).ravel() for _ in range(POSES)])
    mean = poses.mean(axis=0)
    _, spread, components = np.linalg.svd(poses - mean, full_matrices=False)
    deviations = np.maximum(spread / np.sqrt(POSES - 1), LEAST)
    path = Path(pose_components.__file__).parent / pose_components.TABLE
    with path.open("wb") as stream:
        np.savez_compressed(
            stream,
            mean=mean.astype(np.float32),
            components=components.astype(np.float32),
            deviations=deviations.astype(np.float32),
        )
    kept = (deviations > LEAST).sum()
    print(f"{path}: {POSES} poses, {kept} components vary by more than {np.degrees(LEAST):.0f}°.")


if __name__ == "__main__":
    main()
