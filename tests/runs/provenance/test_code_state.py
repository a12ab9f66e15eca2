"""The state of the code has git's revision, the changes since, new files, the lock and the packages."""

import hashlib
import importlib.metadata
import subprocess
from pathlib import Path

import pytest

from hand_recon import __version__
from hand_recon.runs.provenance.code_state import code_state


def git(root: Path, *words: str) -> str:
    """Run git in a new repository."""
    identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    command = ["git", "-C", str(root), *identity, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()  # noqa: S603


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "hand_recon").mkdir()
    (tmp_path / "hand_recon" / "a.py").write_text("A = 1\n")
    (tmp_path / "requirements.lock").write_text("torch==2\n")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "first")
    return tmp_path


def test_a_clean_checkout_has_its_revision_and_the_hash_of_its_lock(checkout: Path) -> None:
    state = code_state(checkout)
    assert state.revision == git(checkout, "rev-parse", "HEAD")
    assert (state.diff, state.untracked) == ("", {})
    assert state.lock == hashlib.sha256(b"torch==2\n").hexdigest()
    assert state.version == __version__
    assert state.packages["torch"] == importlib.metadata.version("torch")
    assert state.entries()["diff"] is None


def test_changes_and_new_files_are_kept(checkout: Path) -> None:
    (checkout / "hand_recon" / "a.py").write_text("A = 2\n")
    (checkout / "hand_recon" / "b.py").write_text("B = 1\n")
    (checkout / "notes.txt").write_text("no code\n")
    state = code_state(checkout)
    assert "-A = 1\n+A = 2" in state.diff
    assert state.untracked == {"hand_recon/b.py": hashlib.sha256(b"B = 1\n").hexdigest()}
    assert state.entries()["diff"] == hashlib.sha256(state.diff.encode()).hexdigest()


def test_the_patch_does_not_depend_on_a_users_settings_and_can_be_applied(checkout: Path) -> None:
    (checkout / ".gitattributes").write_text("*.py diff=upper\n")
    (checkout / "hand.bin").write_bytes(b"\0\1")
    git(checkout, "add", ".")
    git(checkout, "commit", "-q", "-m", "second")
    for name, value in (("color.ui", "always"), ("diff.upper.textconv", "tr a-z A-Z <")):
        git(checkout, "config", name, value)
    (checkout / "hand_recon" / "a.py").write_text("a = 2\n")
    (checkout / "hand.bin").write_bytes(b"\0\2")
    diff = code_state(checkout).diff
    assert "\n-A = 1\n+a = 2\n" in diff
    git(checkout, "checkout", "-q", ".")
    (checkout / "changes.patch").write_text(diff)
    git(checkout, "apply", "changes.patch")
    assert (checkout / "hand.bin").read_bytes() == b"\0\2"


def test_an_installed_package_has_its_version_alone(tmp_path: Path) -> None:
    state = code_state(tmp_path)
    assert (state.revision, state.lock, state.diff) == (None, None, "")
    assert state.version == __version__
