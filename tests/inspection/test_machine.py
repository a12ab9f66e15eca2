"""The machine's checks agree with PyTorch, and do without it where there is no accelerator."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from hand_recon.inspection import machine
from hand_recon.inspection.machine import (
    cuda_of_torch,
    look_at_backbone_weights,
    look_at_devices,
    may_have_accelerator,
    torch_hub_folder,
)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A Linux machine without a driver; files below the folder stand for those of drivers."""
    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setattr(machine, "GPU_FILES", (f"{tmp_path}/dev/nvidia*",))
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    return tmp_path


def test_looking_imports_none_of_the_slow_libraries() -> None:
    slow = ("torch", "torchvision", "lightning", "torchmetrics", "cv2", "matplotlib", "scipy")
    program = (
        "import sys, pathlib\n"
        "from hand_recon.inspection import caches, datasets, machine\n"
        "nowhere = pathlib.Path('/nowhere')\n"
        "machine.GPU_FILES, machine.shutil.which = (), lambda _: None\n"
        "machine.platform.system = lambda: 'Linux'\n"
        "machine.look_at_versions(), machine.look_at_devices(), machine.look_at_backbone_weights()\n"
        "caches.look_at_caches(nowhere), datasets.look_at_mano(nowhere), datasets.look_at_datasets(nowhere)\n"
        f"print([name for name in {slow} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)  # noqa: S603  # fmt: skip
    assert done.stdout == "[]\n"


def test_a_driver_is_reason_to_ask_pytorch_and_nothing_is_reason_not_to(
    bare: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not may_have_accelerator()
    (bare / "dev").mkdir()
    (bare / "dev" / "nvidia0").touch()
    assert may_have_accelerator()
    for hidden in ("", "-1"):
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", hidden)
        assert not may_have_accelerator()
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    assert may_have_accelerator()
    (bare / "dev" / "nvidia0").unlink()
    assert not may_have_accelerator()
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    assert may_have_accelerator()


@pytest.mark.parametrize(("chip", "may"), [("arm64", True), ("x86_64", False)])
def test_apples_own_chips_may_have_an_accelerator(
    monkeypatch: pytest.MonkeyPatch, chip: str, *, may: bool
) -> None:
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    monkeypatch.setattr("platform.machine", lambda: chip)
    assert may_have_accelerator() is may


def test_devices_are_those_that_pytorch_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "may_have_accelerator", lambda: True)
    card = SimpleNamespace(name="A card", total_memory=24 * 2**30)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda _: card)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    found = [(one.subject, one.state, one.found) for one in look_at_devices()[1:]]
    assert found == [("GPU 0", "good", "A card, 24 GiB"), ("GPU 1", "good", "A card, 24 GiB")]
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    (absent,) = look_at_devices()[1:]
    assert (absent.subject, absent.state) == ("GPU", "absent")
    assert bool(absent.cure) == (torch.version.cuda is not None)


def test_without_a_driver_there_is_no_accelerator(
    bare: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not list(bare.iterdir())
    monkeypatch.setattr(torch.cuda, "device_count", lambda: pytest.fail("PyTorch was asked"))
    assert [(one.subject, one.state) for one in look_at_devices()] == [
        ("CPU", "good"), ("GPU", "absent"),
    ]  # fmt: skip


def test_pytorchs_cuda_version_is_read_from_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cuda_of_torch() == torch.version.cuda
    origin = SimpleNamespace(origin=str(tmp_path / "__init__.py"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: origin)
    assert cuda_of_torch() is None
    for line, expected in (
        ("cuda: Optional[str] = '12.8'", "12.8"),
        ("cuda = '11.8'", "11.8"),
        ("cuda: Optional[str] = None", None),
    ):
        (tmp_path / "version.py").write_text(f"debug = False\n{line}\nhip: Optional[str] = '6.1'\n")
        assert cuda_of_torch() == expected
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert cuda_of_torch() is None


@pytest.mark.parametrize(
    "environment",
    [{}, {"XDG_CACHE_HOME": "/caches"}, {"TORCH_HOME": "~/torch"},
     {"TORCH_HOME": "/t", "XDG_CACHE_HOME": "/caches"}],
)  # fmt: skip
def test_the_folder_of_downloads_is_pytorchs(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("XDG_CACHE_HOME", "TORCH_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(torch_hub_folder()) == torch.hub.get_dir()


def test_weights_that_were_downloaded_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    assert look_at_backbone_weights().state == "absent"
    folder = tmp_path / "hub" / "checkpoints"
    folder.mkdir(parents=True)
    (folder / "resnet50-11ad3fa6.pth").touch()
    found = look_at_backbone_weights()
    assert (found.state, found.found) == ("good", "resnet50-11ad3fa6.pth")
