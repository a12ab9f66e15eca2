"""Networks of runs as ONNX files: the same hands as PyTorch's, their crops in the file, and refusals."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, open_dict

from hand_recon.data.augment import to_float
from hand_recon.formats.onnx_graphs import LifterGraph
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.lifter_file import SHIPPED
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.runs.checkpoints import load_trained
from hand_recon.runs.export_run import export
from hand_recon.runs.onnx_run import export_onnx, load_graph
from hand_recon.runs.sigma_calibration import SIGMA_FACTOR_KEY
from hand_recon.schema import HandBatch
from tests.support.configurations import composed
from tests.support.mano_file import write_mano_folder
from tests.support.onnx_sessions import (
    example_of,
    outputs_of,
    session_of,
    shapes_of,
    unchecked_shapes,
)
from tests.support.photo_checkpoint import IMAGES, LIFTER, PHOTOS, write_run

LARGEST = 1e-4
"""Largest difference to PyTorch, metres."""

SMALL_PHOTOS = (
    *PHOTOS, "model.encoder.backbone=resnet18", "model.iterations=1", "model.encoder.turns=[]",
)  # fmt: skip
"""A network of few operators, which looks at a crop once and has one round of feedback."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of a small network for photographs with σ three times as large as it says."""
    folder = write_run(tmp_path_factory.mktemp("photos") / "run", *SMALL_PHOTOS, sharpness=1e4)
    file = folder / "checkpoints" / "best.ckpt"
    torch.save(torch.load(file) | {SIGMA_FACTOR_KEY: 3.0}, file)
    return folder


@pytest.fixture(scope="module")
def photos(run: Path) -> Path:
    """ONNX file of that network; the translation takes too long for the tests that always run."""
    needs_extra()
    return exported(run, run.parent / "onnx")


def exported(source: str | Path, output: Path) -> Path:
    """The ONNX file of a network."""
    with unchecked_shapes():
        (file,) = export_onnx(asked(source, output))
    return file


def needs_extra() -> None:
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason="needs the extra onnx")


def asked(source: str | Path, output: str | Path, *words: str) -> DictConfig:
    config = composed(
        f"source='{source}'", f"output='{output}'", "format=onnx", *words, name="export"
    )
    with open_dict(config):
        del config["hydra"]
    return config


def network_of(run: Path) -> tuple[Regressor, int]:
    """A network as `hand-recon predict` uses it, and the side of its crops."""
    trained = load_trained(run)
    regressor = trained.module.regressor
    regressor.use_intrinsics = True
    if isinstance(regressor.encoder, PhotoEncoder):
        regressor.encoder.gives_landmarks = True
    return regressor, int(trained.config.crop_size)


def batch_of(inputs: dict[str, torch.Tensor]) -> HandBatch:
    """The inputs of an ONNX network as a batch of samples; missing values are NaN."""
    hands = len(inputs["image"])
    given = inputs.get("given", torch.zeros(hands, 21, dtype=torch.bool))
    points = inputs.get("observed_2d", torch.zeros(hands, 21, 2))
    confidence = inputs.get("confidence")
    if confidence is not None:
        confidence = torch.where(confidence < 0, torch.nan, confidence)
    return to_float(
        HandBatch(
            image=inputs["image"].permute(0, 3, 1, 2).contiguous(),
            landmarks_2d=torch.where(given[..., None], points, torch.nan),
            labelled=given,
            index=torch.arange(hands),
            source=("",) * hands,
            intrinsics=inputs["intrinsics"],
            confidence=confidence,
        )
    )


def assert_same_hands(run: Path, file: Path | None = None, sigma_factor: float = 1.0) -> None:
    """Fail unless an ONNX file, or without one its graph in PyTorch, gives the hands of a run's network."""
    regressor, size = network_of(run)
    graph = load_graph(str(run), open_hand())[0]
    session = None if file is None else session_of(file.read_bytes())
    for hands in (1, 2, 7, 64):
        inputs = example_of(graph, hands)
        with torch.no_grad():
            expected = regressor(batch_of(inputs))
            values = [value.numpy() for value in graph(*inputs.values())]
        found = (
            outputs_of(session, inputs)
            if session
            else dict(zip(graph.outputs, values, strict=True))
        )
        sigma = expected.log_sigma.exp() * (sigma_factor * size / 224)
        for name, tensor, unit in (
            ("landmarks_3d", expected.landmarks_3d, 1.0),
            ("vertices", expected.vertices, 1.0),
            ("translation", expected.parameters.translation, 1.0),
            ("joint_angles", expected.parameters.joint_angles, 1.0),
            # A tenth of a millimetre half a metre away is a tenth of a pixel.
            ("landmarks_2d", expected.landmarks_2d, 1e3),
            ("found_2d", expected.located_2d, 1e3),
            ("sigma_2d", sigma, 1e3),
        ):
            if tensor is not None:
                assert np.abs(found[name] - tensor.numpy()).max() <= LARGEST * unit, (hands, name)


def test_the_graph_of_a_network_for_photographs_is_the_network(run: Path) -> None:
    assert_same_hands(run, sigma_factor=3.0)


@pytest.mark.slow
def test_a_network_for_photographs_gives_the_same_hands(run: Path, photos: Path) -> None:
    assert_same_hands(run, photos, sigma_factor=3.0)


@pytest.mark.slow
def test_a_network_for_photographs_sees_pixels_and_given_landmarks(run: Path, photos: Path) -> None:
    session = session_of(photos.read_bytes())
    inputs = example_of(load_graph(str(run), open_hand())[0], 4)
    told = inputs["given"].any(dim=1).numpy()
    assert told.tolist() == [False, True, False, True]
    before = outputs_of(session, inputs)["landmarks_3d"]
    moved = outputs_of(session, inputs | {"observed_2d": inputs["observed_2d"] + 3})
    change = np.abs(moved["landmarks_3d"] - before).max(axis=(1, 2))
    assert (change[told] > 1e-4).all()
    assert (change[~told] == 0).all()
    dark = outputs_of(session, inputs | {"image": inputs["image"] // 2})["landmarks_3d"]
    assert (np.abs(dark - before).max(axis=(1, 2)) > 0).all()


@pytest.mark.slow
def test_the_file_names_its_crops_checkpoint_and_terms(run: Path, photos: Path) -> None:
    import onnx

    file = photos
    assert file.name == "photos.onnx"
    assert [path.name for path in file.parent.iterdir()] == ["photos.onnx"]
    about = {entry.key: entry.value for entry in onnx.load(file).metadata_props}
    checkpoint = run / "checkpoints" / "best.ckpt"
    assert about["checkpoint_sha256"] == hashlib.sha256(checkpoint.read_bytes()).hexdigest()
    assert about["network"] == "photos"
    assert (about["crop_size"], about["crop_around"], about["crop_expansion"]) == (
        "64",
        "joints",
        "1.5",
    )
    assert "whoever trained them" in about["licence"]
    shapes = shapes_of(session_of(file.read_bytes()))
    assert shapes["image"] == ["batch", 64, 64, 3]
    assert shapes["found_2d"] == ["batch", 21, 2]
    assert set(json.loads(about["units"])) == set(shapes)


@pytest.mark.parametrize("output", ["", "lifter.onnx"], ids=["a folder", "a file"])
def test_nothing_is_overwritten(tmp_path: Path, output: str) -> None:
    needs_extra()
    (tmp_path / "lifter.onnx").write_text("mine")
    with pytest.raises(FileExistsError, match=r"lifter\.onnx exists and is not overwritten"):
        export_onnx(asked("default", tmp_path / output))
    assert (tmp_path / "lifter.onnx").read_text() == "mine"


def test_sources_that_are_no_networks_are_refused(tmp_path: Path) -> None:
    needs_extra()
    with pytest.raises(ValueError, match=r"hands\.json is a file of hands\. Give default"):
        export_onnx(asked(tmp_path / "hands.json", tmp_path))
    with pytest.raises(FileNotFoundError, match=r"No network at .*nowhere"):
        export_onnx(asked(tmp_path / "nowhere", tmp_path))
    config = composed("format=onnx", name="export")
    with pytest.raises(ValueError, match="hand-recon export default format=onnx"):
        export_onnx(config)


def test_a_network_is_written_by_a_command_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"Found format=glb,onnx.*a command of its own"):
        export(asked("default", tmp_path, "format=[glb,onnx]"))


def test_the_packaged_lifter_is_under_the_packages_licence(hand: HandModel) -> None:
    graph, about = load_graph("default", hand)
    assert graph.inputs == ("observed_2d", "given", "intrinsics")
    assert about["checkpoint_sha256"] == hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    assert about["licence"].startswith("Apache-2.0")


def test_a_run_of_a_lifter_is_a_lifter(tmp_path: Path, hand: HandModel) -> None:
    graph, about = load_graph(str(write_run(tmp_path / "run", *LIFTER)), hand)
    assert isinstance(graph, LifterGraph)
    assert graph.inputs == ("observed_2d", "given", "intrinsics", "confidence")
    assert "crop_size" not in about


def test_a_licensed_hand_is_not_passed_on(tmp_path: Path, hand: HandModel) -> None:
    mano = write_mano_folder(tmp_path / "mano")
    run = write_run(
        tmp_path / "run", *IMAGES, "hand=mano", f"hand.path='{mano}'", "data.landmark_set=mano"
    )
    assert "do not pass the file on" in load_graph(str(run), hand)[1]["licence"]


@pytest.mark.slow
@pytest.mark.parametrize("hands", [1, 2, 7, 64])
def test_the_packaged_lifter_gives_the_same_hands(packaged: Path, hands: int) -> None:
    graph, _ = load_graph("default", open_hand())
    inputs = example_of(graph, hands)
    with torch.no_grad():
        expected = dict(zip(graph.outputs, graph(*inputs.values()), strict=True))
    found = outputs_of(session_of(packaged.read_bytes()), inputs)
    for name in ("landmarks_3d", "vertices"):
        assert np.abs(found[name] - expected[name].numpy()).max() <= LARGEST


@pytest.fixture(scope="module")
def packaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packaged lifter's ONNX file."""
    needs_extra()
    return exported("default", tmp_path_factory.mktemp("packaged") / "my.onnx")


@pytest.mark.slow
@pytest.mark.parametrize("overrides", [PHOTOS, IMAGES], ids=["six looks", "images"])
def test_networks_of_all_recipes_give_the_same_hands(
    overrides: tuple[str, ...], tmp_path: Path
) -> None:
    needs_extra()
    folder = write_run(tmp_path / "run", *overrides, sharpness=1e4)
    assert_same_hands(folder, exported(folder, tmp_path / "onnx"))
