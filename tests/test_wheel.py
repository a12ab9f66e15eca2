"""The wheel works without a checkout: built, installed into an empty environment, run from elsewhere."""

import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
BLOCKER = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names}:
            raise ImportError(f"{{name}} belongs to an extra that is not installed")
sys.meta_path.insert(0, Blocker())
"""
"""Hides packages from an environment that shares its dependencies with the tests' own."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)  # noqa: S603  # our own words
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_carries_configuration_assets_and_templates(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    source = {path.relative_to(ROOT).as_posix() for path in (ROOT / "conf").rglob("*.yaml")}
    assert {f"hand_recon/{path}" for path in source} <= names
    package = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "hand_recon").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert package <= names
    assert not [name for name in names if name.startswith(("tests/", "tools/", "conf/"))]


def test_the_installed_wheel_fits_hands_from_another_folder_without_the_extras(
    wheel: Path, tmp_path: Path
) -> None:
    environment = tmp_path / "env"
    venv.create(environment, with_pip=False)
    python = environment / "bin" / "python"
    site = Path(
        subprocess.run(  # noqa: S603  # our own words
            [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
            check=True, capture_output=True, text=True,
        ).stdout.strip()
    )  # fmt: skip
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    # The dependencies alone: a .pth file of the shared folder, such as the checkout's own, is not read.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    names = ("train", "detect", "heif", "onnx", "demo", "usd", "rerun")
    optional = [line for name in names for line in extras[name]]
    hidden = {Requirement(line).name.replace("-", "_") for line in optional}
    # Jinja2 comes with torch.
    hidden = (hidden - {"jinja2"}) | {"joblib", "pytest"}
    (site / "sitecustomize.py").write_text(BLOCKER.format(names=hidden))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "hands.json").write_bytes((ROOT / "examples" / "hands.json").read_bytes())
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "HAND_RECON"))}
    words = ["-m", "hand_recon", "fit", "hands.json", "--output", "out", "descent.steps=5"]
    done = subprocess.run(  # noqa: S603  # our own words
        [python, *words], cwd=elsewhere, env=clean, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (elsewhere / "out" / "fits.png").is_file()
    where = [str(python), "-c", "import hand_recon; print(hand_recon.__file__)"]
    printed = subprocess.run(  # noqa: S603  # our own words
        where, cwd=elsewhere, env=clean, check=True, capture_output=True, text=True
    )
    assert Path(printed.stdout.strip()).parent == site / "hand_recon"
