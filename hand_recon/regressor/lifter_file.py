"""The file of a lifter: weights as safetensors, with all that it takes to build the network again.

The header names the network's settings, the hand that the lifter was trained for and a digest of the
weights. Settings are numbers and switches, so that a file from elsewhere can call nothing.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder

SHIPPED: Final = Path(__file__).parent / "assets" / "lifter.safetensors"
"""Lifter of the package, made by `make shipped-lifter`; docs/lifter.md is its model card."""

FORMAT: Final = "hand_recon lifter 1"
"""Name and version of the format, in the header."""

LARGEST: Final = 8192
"""Largest setting that is built: the network of a file from elsewhere is made before its weights are seen."""

ENTRIES: Final = ("settings", "hand", "landmark_set", "weights")
"""Further entries that every header has."""


@dataclass(frozen=True)
class LifterSettings:
    """Settings of a lifter's network; names as in `Regressor` and `LandmarkEncoder`."""

    width: int = 512
    """Size of all hidden layers."""
    depth: int = 2
    """Hidden layers of the encoder after the first."""
    iterations: int = 3
    """Rounds of feedback."""
    reprojection: bool = True
    """True if each round sees the reprojection error of the last one."""
    confidence: bool = True
    """True if the detector's confidence is part of the input."""

    def build(self, hand: HandModel) -> Regressor:
        """Build the network with fresh weights.

        Args:
            hand: The hand that it predicts.
        """
        encoder = LandmarkEncoder(self.width, self.depth, 0.0, confidence=self.confidence)
        return Regressor(
            encoder,
            hand,
            iterations=self.iterations,
            width=self.width,
            dropout=0.0,
            activation=True,
            reprojection=self.reprojection,
        )


def fingerprint(hand: HandModel) -> str:
    """Digest of a hand model's arrays, without its landmark set: equal for equal assets."""
    digest = hashlib.sha256()
    for name, buffer in sorted(hand.named_buffers(recurse=False)):
        if name != "landmark_regressor":
            digest.update(buffer.detach().cpu().contiguous().numpy().tobytes())
    return f"{hand.name} {digest.hexdigest()[:16]}"


def weights_digest(weights: Mapping[str, Tensor]) -> str:
    """SHA-256 of tensors: their names, types, shapes and bytes, in the order of the names."""
    digest = hashlib.sha256()
    for name, tensor in sorted(weights.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}\n".encode())
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def save_lifter(
    path: Path, regressor: Regressor, settings: LifterSettings, origin: Mapping[str, str]
) -> str:
    """Write a lifter in half precision.

    Args:
        path: The file.
        regressor: Trained network, as `settings` build it.
        settings: Its settings.
        origin: Further entries of the header, such as the command that made it.

    Returns:
        Digest of the weights.
    """
    weights = {name: tensor.half() for name, tensor in regressor.state_dict().items()}
    digest = weights_digest(weights)
    header = {
        **origin,
        "format": FORMAT,
        "settings": json.dumps(asdict(settings)),
        "hand": fingerprint(regressor.hand),
        "landmark_set": regressor.hand.landmark_set,
        "weights": digest,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    save_file(weights, path, header)
    return digest


def load_lifter(path: Path, hands: Callable[[str, str], HandModel | None]) -> Regressor:
    """Read a lifter, with its own hand.

    Args:
        path: File that `save_lifter` wrote.
        hands: Function from a hand's fingerprint and landmark set to that hand; None if it is not here.

    Returns:
        The network in single precision and evaluation mode.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no lifter, is damaged, or was made for a hand that is not here.
    """
    header, weights = _read(path)
    settings = _settings(path, header["settings"])
    hand = hands(header["hand"], header["landmark_set"])
    if hand is None:
        raise ValueError(
            f"{path} was made for the hand {header['hand']!r}, which is not here: its angles and shapes mean "
            "nothing for another hand. Use lifter=default, or a lifter that was trained for this hand."
        )
    regressor = _network(path, settings, hand)
    _check_weights(path, weights, regressor.state_dict())
    regressor.load_state_dict({name: tensor.float() for name, tensor in weights.items()})
    return regressor.eval()


def lifter_header(path: Path) -> dict[str, str]:
    """Read what a lifter's file says about it; errors as for `load_lifter`."""
    return _read(path)[0]


def _settings(path: Path, written: str) -> LifterSettings:
    """Settings from a header: numbers and switches of the known names, nothing else."""
    known = asdict(LifterSettings())
    try:
        found = json.loads(written)
    except (ValueError, RecursionError):
        found = None
    kinds = {name: type(value) for name, value in found.items()} if isinstance(found, dict) else {}
    expected = {name: type(value) for name, value in known.items()}
    if kinds != expected:
        raise ValueError(
            f"{path} has the settings {written}; expected {json.dumps(known)} with other numbers. It was "
            "written by another version of hand_recon: use that one, or train again."
        )
    return LifterSettings(**found)


def _network(path: Path, settings: LifterSettings, hand: HandModel) -> Regressor:
    """Network of some settings; ValueError if there is none, such as one of width 0."""
    sizes = settings.width, settings.iterations, settings.depth
    if min(sizes[:2]) < 1 or settings.depth < 0 or max(sizes) > LARGEST:
        raise ValueError(
            f"{path} has the settings {json.dumps(asdict(settings))}; expected a width and a number of "
            f"iterations of 1 or more, a depth of 0 or more, and none above {LARGEST}. Make the file again "
            "with `make shipped-lifter`, or use lifter=default."
        )
    return settings.build(hand)


def _check_weights(path: Path, found: Mapping[str, Tensor], expected: Mapping[str, Tensor]) -> None:
    """Check that weights are those of a network with the header's settings."""
    shapes = {name: tuple(tensor.shape) for name, tensor in found.items()}
    wanted = {name: tuple(tensor.shape) for name, tensor in expected.items()}
    if shapes != wanted:
        name = min(name for name in {*shapes, *wanted} if shapes.get(name) != wanted.get(name))
        raise ValueError(
            f"{path} has weights of another network than its settings describe: {name} has the shape "
            f"{shapes.get(name)}; expected {wanted.get(name)} (None: there is none). Make the file again "
            "with `make shipped-lifter`, or use lifter=default."
        )


def _read(path: Path) -> tuple[dict[str, str], dict[str, Tensor]]:
    if not path.is_file():
        raise FileNotFoundError(
            f"No lifter at {path}. Give lifter=default (that of the package), lifter=none, a safetensors "
            "file of `make shipped-lifter`, or a run's folder."
        )
    try:
        with safe_open(path, framework="pt") as file:
            header = dict(file.metadata() or {})
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ValueError(
            f"{path} is no safetensors file ({error}). Give one of `make shipped-lifter`."
        ) from error
    if header.get("format") != FORMAT:
        raise ValueError(
            f"{path} has the format {header.get('format')!r}; expected {FORMAT!r}, as `make shipped-lifter` "
            "writes it."
        )
    missing = [name for name in ENTRIES if name not in header]
    if missing:
        raise ValueError(
            f"{path} has no {', '.join(missing)} in its header; expected {', '.join(ENTRIES)}, as `make "
            "shipped-lifter` writes them. Make it again, or use lifter=default."
        )
    found = weights_digest(weights)
    if found != header["weights"]:
        raise ValueError(
            f"{path} has weights with the digest {found[:16]}…, and its header says "
            f"{header['weights'][:16]}…: the file is damaged or was changed. Restore it with git, or make it "
            "again."
        )
    return header, weights
