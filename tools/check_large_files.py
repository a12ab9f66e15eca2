"""Refuse files that are too large for git, except those in `ALLOWED`."""

import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

LIMIT: Final = 100_000
"""Largest size of a file, bytes."""

ALLOWED: Final[dict[str, int]] = {
    "requirements.lock": 400_000,
    "hand_recon/hand/assets/open_hand.npz": 600_000,
    # The packaged lifter, the one network in the repository (docs/lifter.md).
    "hand_recon/regressor/assets/lifter.safetensors": 4_000_000,
    # three.js as its package has it, which has no smaller build any more (decision 86).
    "hand_recon/page/static/vendor/three/three.core.js": 1_500_000,
    "hand_recon/page/static/vendor/three/three.module.js": 700_000,
    "docs/images/*": 400_000,
    "tests/golden/*": 300_000,
}
"""Larger limits, bytes, by pattern of the path in the repository."""


def limit_of(path: str) -> int:
    """Largest size of the file at a path, bytes."""
    return max((size for pattern, size in ALLOWED.items() if fnmatch(path, pattern)), default=LIMIT)


def too_large(root: Path, paths: list[str]) -> list[str]:
    """Messages about the existing files above their limits, one per file."""
    sizes = {path: (root / path).stat().st_size for path in paths if (root / path).is_file()}
    return [
        f"{path} has {size} bytes, more than its limit of {limit_of(path)}."
        for path, size in sizes.items()
        if size > limit_of(path)
    ]


def files_of(root: Path) -> list[str]:
    """Paths of the files that git tracks or would add, in the order of the index.

    Raises:
        subprocess.CalledProcessError: The folder is not a git checkout.
    """
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)  # noqa: S603
    return [path for path in listing.stdout.split("\0") if path]


def main() -> int:
    """Check the repository of this file; the exit status is 1 if a file is too large."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():
        print("Not a git checkout: sizes are not checked.")
        return 0
    complaints = too_large(root, files_of(root))
    for complaint in complaints:
        print(complaint)
    if complaints:
        print(
            "Keep data outside git, make it smaller, or add it to ALLOWED in tools/check_large_files.py."
        )
    return int(bool(complaints))


if __name__ == "__main__":
    sys.exit(main())
