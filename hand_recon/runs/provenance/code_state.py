"""State of the code of a run: git's revision and differences, the lock, the installed packages."""

import hashlib
import importlib.metadata
import platform
import re
import shutil
import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon import __version__
from hand_recon.command_line.configuration_files import PACKAGE

ROOT: Final = PACKAGE.parent
"""The checkout, if the package is in one."""

OWN: Final = ("hand_recon", "conf", "hydra_plugins")
"""Folders of the checkout whose new files are code."""

AS_STORED: Final = ("--no-color", "--no-ext-diff", "--no-textconv", "--binary")
"""Options by which git's patch does not depend on a user's settings, and can be applied."""


@dataclass(frozen=True)
class CodeState:
    """Code that a run was made with."""

    version: str
    """Version of hand_recon."""
    python: str
    """Version of Python."""
    revision: str | None
    """Commit of the checkout; none for an installed package."""
    diff: str
    """Changes of the checkout since that commit, as git's patch; empty for none."""
    untracked: dict[str, str]
    """SHA-256 of new files of the code that git does not have, by path."""
    lock: str | None
    """SHA-256 of requirements.lock; none where there is none."""
    packages: dict[str, str]
    """Versions of the installed packages."""

    def entries(self) -> dict[str, Any]:
        """Entries for JSON; the patch by its SHA-256, since it has a file of its own."""
        return asdict(self) | {"diff": digest(self.diff.encode()) if self.diff else None}


def code_state(root: Path = ROOT) -> CodeState:
    """Read the state of the code.

    Args:
        root: Folder above the package.
    """
    revision = _git(root, "rev-parse", "HEAD") if (root / ".git").exists() else None
    diff, names = "", []
    if revision is not None:
        diff = _git(root, "diff", *AS_STORED, "HEAD") or ""
        listed = _git(root, "ls-files", "--others", "--exclude-standard", "-z", "--", *OWN)
        names = [name for name in (listed or "").split("\0") if (root / name).is_file()]
    lock = root / "requirements.lock"
    return CodeState(
        version=__version__,
        python=platform.python_version(),
        revision=revision.strip() if revision else None,
        diff=diff,
        untracked={name: digest((root / name).read_bytes()) for name in names if name},
        lock=digest(lock.read_bytes()) if lock.is_file() else None,
        packages=_packages(),
    )


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def _packages() -> dict[str, str]:
    found = {
        re.sub(r"[-_.]+", "-", str(one.metadata["Name"])).lower(): one.version
        for one in importlib.metadata.distributions()
        if one.metadata["Name"]
    }
    return dict(sorted(found.items()))


def _git(root: Path, *words: str) -> str | None:
    """Output of git; None if it cannot tell, such as in somebody else's checkout."""
    program = shutil.which("git")
    if program is None:
        return None
    command = [program, "--no-optional-locks", "-C", str(root), *words]
    done = subprocess.run(command, capture_output=True, check=False)  # noqa: S603  # our own words
    return done.stdout.decode("utf-8", "replace") if done.returncode == 0 else None
