"""All rows within one time limit: hands into the device's memory, then training, scores and files per row."""

import argparse
import json
import os
import time
import traceback
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from gpu.packed import BACKBONE, HANDS, IN_3D, PackedHands, read_packed
from gpu.precision import run_in_bfloat16
from gpu.rendered import Order, Renderer
from gpu.resident import ResidentHands, load
from gpu.rows import VIEW, module_of_row, photo_augmentation, photo_network
from gpu.scoring import score
from gpu.training import Plan, train_row
from gpu.weights import save_weights
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.backbones import EFFICIENTNET_LITE0
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.training.module import HandReconstruction

FROZEN: Final = 4
"""Leading layers of EfficientNet-Lite0 that keep their ImageNet weights (conf/model/photos.yaml)."""

LEAST: Final = 1.0
"""Shortest time in which a row is begun, seconds."""


@dataclass(frozen=True)
class Files:
    """Hands in the device's memory."""

    train: ResidentHands
    """Training hands."""
    tests: dict[str, ResidentHands]
    """Test hands by name."""
    rendered: ResidentHands | None
    """Rendered training hands."""
    landmark_set: str
    """Landmark set of the labels."""


@dataclass
class Session:
    """One run of the script: its options, its end, and what it has found so far."""

    options: argparse.Namespace
    """Options of `gpu.train`."""
    end: float
    """Time of the monotonic clock at which everything is to be written."""
    device: torch.device
    """Device of the networks and the hands."""
    report: dict[str, Any] = field(default_factory=dict)
    """Content of report.json."""
    reserved: float = 0.0
    """Time for scores and files of a row, seconds."""

    def left(self) -> float:
        """Seconds that are left."""
        return self.end - time.monotonic()

    def write(self) -> None:
        """Write the report, under another name until it is whole."""
        out: Path = self.options.out
        out.mkdir(parents=True, exist_ok=True)
        unfinished = out / "report.partial"
        unfinished.write_text(json.dumps(self.report, indent=1), encoding="utf-8")
        unfinished.rename(out / "report.json")

    def say(self, line: str) -> None:
        """Print a line, with the time that is left."""
        print(f"[{self.left():5.0f} s left] {line}", flush=True)


def run(options: argparse.Namespace, began: float) -> int:
    """Train all rows; the exit status is 1 if one failed or was left out.

    Args:
        options: Options of `gpu.train`.
        began: Time of the monotonic clock from which the limit counts.

    Raises:
        FileNotFoundError: There are no packed hands, or no weights at the path that was given.
    """
    device = torch.device(options.device or ("cuda" if torch.cuda.is_available() else "cpu"))
    session = Session(options, began + 60 * options.minutes, device, reserved=options.reserve)
    torch.backends.cudnn.benchmark = True
    session.report = {
        "device": torch.cuda.get_device_name(device) if device.type == "cuda" else "processor",
        "torch": torch.__version__,
        "options": {name: _plain(value) for name, value in vars(options).items()},
        "rows": {},
    }
    session.say(f"{session.report['device']}, PyTorch {torch.__version__}")
    files = files_of(session)
    rows = list(options.rows)
    for number, row in enumerate(rows):
        entry = session.report["rows"][f"row{row}"] = {}
        seconds = options.seconds or session.left() / (len(rows) - number) - session.reserved
        seconds = min(seconds, session.left() - session.reserved)
        try:
            if seconds < LEAST:
                raise TimeoutError(f"{seconds:.1f} s are left for this row.")
            train(session, files, row, seconds)
        except Exception as error:  # noqa: BLE001  # The other rows may do without what has failed here.
            entry["failed"] = f"{type(error).__name__}: {error}"
            session.say(f"row {row} failed: {entry['failed']}\n{traceback.format_exc()}")
        session.write()
    session.say(f"{options.out / 'report.json'}")
    return int(any("failed" in entry for entry in session.report["rows"].values()))


def files_of(session: Session) -> Files:
    """Load all hands into the device's memory, rendering beside.

    Args:
        session: The run.

    Raises:
        FileNotFoundError: There are no packed hands.
    """
    options, device = session.options, session.device
    folder: Path = options.folder
    packed = read_packed(folder / HANDS)
    order = Order(
        count=options.rendered,
        seconds=min(options.render_seconds, session.left() / 3),
        processes=options.processes or max(1, (os.cpu_count() or 2) - 1),
        size=options.crop,
        level=options.level,
        landmark_set=packed.landmark_set,
        seed=options.seed,
    )
    with Renderer(order) as renderer:
        train = load(packed, np.flatnonzero(~packed.test), options.crop, device)
        tests = {"test": load(packed, np.flatnonzero(packed.test), options.crop, device)}
        if (folder / IN_3D).is_file():
            tests["in_3d"] = _all_of(read_packed(folder / IN_3D), options.crop, device)
        session.say(f"{len(train)} training hands, {len(tests['test'])} test hands")
        rendered = renderer.hands(device)
    count = 0 if rendered is None else len(rendered)
    session.say(f"{count} rendered hands")
    session.report |= {
        "training_hands": len(train),
        "rendered_hands": count,
        "seconds_before_training": 60 * options.minutes - session.left(),
    }
    return Files(train, tests, rendered, packed.landmark_set)


def _all_of(packed: PackedHands, size: int, device: torch.device) -> ResidentHands:
    return load(packed, np.arange(len(packed)), size, device)


def build(session: Session, row: int, landmark_set: str) -> HandReconstruction:
    """Network, losses and optimizer of a row on the device, with new weights.

    Args:
        session: The run.
        row: Row of Table 1.
        landmark_set: Landmark set of the labels.
    """
    options = session.options
    torch.manual_seed(options.seed)
    weights = options.weights
    shipped = options.folder / BACKBONE
    if weights is None:
        weights = (
            str(shipped) if options.backbone == EFFICIENTNET_LITE0 and shipped.is_file() else "none"
        )
    # Layers with random weights have to learn.
    frozen = FROZEN if options.backbone == EFFICIENTNET_LITE0 and weights != "none" else 0
    hand = open_hand(landmark_set)
    network = photo_network(hand, options.backbone, weights, frozen=frozen)
    module = module_of_row(
        row, network, learning_rate=options.learning_rate, on_gpu=session.device.type == "cuda"
    ).to(session.device)
    encoder = network.encoder
    assert isinstance(encoder, PhotoEncoder)  # noqa: S101
    if options.precision == "bf16":
        run_in_bfloat16(encoder.backbone, compiled=options.compile)
        run_in_bfloat16(encoder.maps)
    session.report["weights"] = {"backbone": weights, "frozen": frozen}
    return module


def train(session: Session, files: Files, row: int, seconds: float) -> None:
    """Train, save and score a row, and put what is found into the report.

    Args:
        session: The run.
        files: Hands in the device's memory.
        row: Row of Table 1.
        seconds: Time limit of the training.
    """
    options, began = session.options, time.monotonic()
    entry = session.report["rows"][f"row{row}"]
    session.say(f"row {row}: {seconds:.0f} s")
    module = build(session, row, files.landmark_set)
    plan = Plan(
        seconds=seconds - (time.monotonic() - began),
        steps=options.steps,
        batch_size=options.batch,
        rendered_share=options.rendered_share,
        seed=options.seed,
        every=options.every,
    )
    try:
        trained = train_row(module, files.train, files.rendered, photo_augmentation(), plan)
    except RuntimeError as error:
        if not options.compile:
            raise
        session.say(f"The compiled network fails, so that none is compiled any more: {error}")
        options.compile = False
        train(session, files, row, seconds - (time.monotonic() - began))
        return
    entry |= asdict(trained)
    session.say(f"row {row}: {trained.steps} steps, {trained.images_per_second:.0f} images/s")
    ended = time.monotonic()
    if row in (options.saved_rows or options.rows):
        entry["weights"] = [path.name for path in _saved(session, files, row, module)]
    session.write()
    entry["scores"] = {}
    for name, hands in files.tests.items():
        entry["scores"][name] = score(module, hands, options.batch)
        session.say(f"row {row}, {name}: {_shown(entry['scores'][name]['all'])}")
    session.reserved = max(session.reserved, 1.2 * (time.monotonic() - ended))


def _saved(session: Session, files: Files, row: int, module: HandReconstruction) -> list[Path]:
    """Write the weights of a row."""
    options = session.options
    header = {
        "row": str(row), "backbone": options.backbone, "crop_size": str(options.crop), "view": str(VIEW),
        "landmark_set": files.landmark_set,
    }  # fmt: skip
    largest = int(options.largest * 2**20)
    return save_weights(options.out / f"row{row}", module.regressor, header, largest)


def _shown(scores: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in scores.items())


def _plain(value: object) -> object:
    return str(value) if isinstance(value, Path) else value
