"""Formats of other programs by their names: what the command `export` and the page offer (decision 84).

    hands = exported_hands(read_hands("hands.json"), hand)
    write("glb", hands, folder)

Every writer takes hands and a folder, and returns the files that it wrote there. Names of files begin with
the scene's name (`clip`, or the photograph's), and no file is ever replaced.
"""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Literal

from hand_recon.formats.animated_glb import write_animated_glb
from hand_recon.formats.bvh import write_bvh
from hand_recon.formats.clinical_table import write_clinical_table
from hand_recon.formats.dex_retargeting import write_dex_retargeting
from hand_recon.formats.exported_hands import ExportedHand, ExportedHands, Scene
from hand_recon.formats.glb_extras import glb_extras
from hand_recon.formats.mano_parameters import write_mano_parameters
from hand_recon.formats.mesh_sequence import write_mesh_sequence
from hand_recon.formats.opensim import write_mot, write_trc
from hand_recon.formats.rerun_recording import write_rerun
from hand_recon.formats.usd import write_usd
from hand_recon.formats.xr_json import OPENXR, UNITY, WEBXR, XrFlavour, write_xr_json
from hand_recon.hand.model import HandModel

Writer = Callable[[ExportedHands, Path], list[Path]]

Holds = Literal["all", "scene", "hand", "frame"]
"""Contents of one file: all hands, those of one scene, one hand, or one frame of a scene."""


@dataclass(frozen=True)
class Format:
    """A format of another program."""

    name: str
    """Name on the command line and in the page."""
    purpose: str
    """Programs that read it, in a line."""
    suffix: str
    """End of a file's name."""
    holds: Holds
    """Contents of one file."""
    writer: Writer
    """Function that writes hands to a folder."""
    module: str | None = None
    """Package that it needs besides; None for none."""
    extra: str | None = None
    """Extra of hand_recon with that package."""
    hand: str | None = None
    """Hand model that it needs; None for any."""

    @property
    def is_available(self) -> bool:
        """True if the package that it needs is installed."""
        return self.module is None or importlib.util.find_spec(self.module) is not None


def write(name: str, hands: ExportedHands, folder: str | Path) -> list[Path]:
    """Write hands in one format; folders are made.

    Args:
        name: A key of `FORMATS`.
        hands: The hands.
        folder: Folder to write to.

    Returns:
        The files, in the order of scenes and hands.

    Raises:
        FileExistsError: A file exists.
        ModuleNotFoundError: The format needs a package that is not installed.
        ValueError: The format is unknown, needs another hand model, or cannot hold these hands.
    """
    chosen = format_named(name)
    check(chosen, hands)
    return chosen.writer(hands, Path(folder))


def check(chosen: Format, hands: ExportedHands) -> None:
    """Check that a format can be written.

    Args:
        chosen: The format.
        hands: The hands.

    Raises:
        ModuleNotFoundError: It needs a package that is not installed.
        ValueError: It needs another hand model.
    """
    if not chosen.is_available:
        raise ModuleNotFoundError(
            f"format={chosen.name} needs {chosen.module}, which is not installed. Install the extra: "
            f"pip install 'hand_recon[{chosen.extra}]'.",
            name=chosen.module,
        )
    if chosen.hand not in (None, hands.hand.name):
        raise ValueError(
            f"format={chosen.name} needs hands of the hand model {chosen.hand}; these are of "
            f"{hands.hand.name}. Make them with hand={chosen.hand}: hand-recon predict … hand={chosen.hand}."
        )


def format_named(name: str) -> Format:
    """Look a format up.

    Args:
        name: Its name.

    Raises:
        ValueError: There is no such format.
    """
    if name not in FORMATS:
        raise ValueError(f"Unknown format {name!r}; expected one of {', '.join(FORMATS)}.")
    return FORMATS[name]


def _of_scenes(
    write_one: Callable[[Path, Scene, HandModel], Path],
    suffix: str,
    hands: ExportedHands,
    folder: Path,
) -> list[Path]:
    """Write a file for each scene."""
    return [
        write_one(folder / f"{scene.name}{suffix}", scene, hands.hand) for scene in hands.scenes
    ]


def _of_hands(
    write_one: Callable[[Path, ExportedHand, HandModel], Path],
    suffix: str,
    hands: ExportedHands,
    folder: Path,
) -> list[Path]:
    """Write a file for each hand."""
    return [
        write_one(folder / f"{scene.name}_{one.name}{suffix}", one, hands.hand)
        for scene, one in hands
    ]


def _meshes(suffix: str, hands: ExportedHands, folder: Path) -> list[Path]:
    return [
        path
        for scene in hands.scenes
        for path in write_mesh_sequence(folder, scene, hands.hand, suffix)
    ]


def _csv(hands: ExportedHands, folder: Path) -> list[Path]:
    return [write_clinical_table(folder / "angles.csv", hands)]


def _glb(path: Path, scene: Scene, hand: HandModel) -> Path:
    extras = [glb_extras(one) for one in scene.hands]
    return write_animated_glb(path, scene.trajectories, hand, extras=extras)


def _bvh(path: Path, one: ExportedHand, hand: HandModel) -> Path:
    return write_bvh(path, one.trajectory, hand)


def _without_model(
    write_one: Callable[[Path, ExportedHand], Path],
) -> Callable[[Path, ExportedHand, HandModel], Path]:
    return lambda path, one, _: write_one(path, one)


def _xr(flavour: XrFlavour) -> Callable[[Path, Scene, HandModel], Path]:
    return lambda path, scene, hand: write_xr_json(path, scene, hand, flavour)


def _scene_format(
    name: str,
    purpose: str,
    suffix: str,
    write_one: Callable[[Path, Scene, HandModel], Path],
    package: tuple[str, str] | None = None,
) -> Format:
    """A format with a file for each scene; `package` is a module and the extra that has it."""
    module, extra = package or (None, None)
    return Format(
        name, purpose, suffix, "scene", partial(_of_scenes, write_one, suffix), module, extra
    )


def _hand_format(
    name: str,
    purpose: str,
    suffix: str,
    write_one: Callable[[Path, ExportedHand, HandModel], Path],
    hand: str | None = None,
) -> Format:
    """A format with a file for each hand; `hand` is the hand model that it needs."""
    writer = partial(_of_hands, write_one, suffix)
    return Format(name, purpose, suffix, "hand", writer, hand=hand)


FORMATS: Final = {
    one.name: one
    for one in (
        _scene_format("glb", "skinned, animated hands for viewers, game engines, Blender", ".glb", _glb),
        _hand_format("bvh", "skeleton and motion for animation programs", ".bvh", _bvh),
        _scene_format(
            "usd", "skinned, animated hands for Omniverse, Houdini, Maya", ".usdc", write_usd, ("pxr", "usd"),
        ),
        Format("obj", "a mesh for each frame", ".obj", "frame", partial(_meshes, ".obj")),
        Format("ply", "a mesh for each frame, with colours", ".ply", "frame", partial(_meshes, ".ply")),
        Format("csv", "joint angles in degrees under their clinical names", ".csv", "all", _csv),
        _hand_format("trc", "landmarks as markers for OpenSim", ".trc", _without_model(write_trc)),
        _hand_format("mot", "joint angles for OpenSim", ".mot", _without_model(write_mot)),
        _scene_format(
            "openxr", "26 hand joints of OpenXR (Isaac Teleop's, too)", ".openxr.json", _xr(OPENXR),
        ),
        _scene_format("webxr", "25 hand joints of WebXR", ".webxr.json", _xr(WEBXR)),
        _scene_format("unity", "26 hand joints of Unity's XR Hands", ".unity.json", _xr(UNITY)),
        _hand_format(
            "dex", "21 points for dex-retargeting and AnyTeleop", ".dex.npz",
            _without_model(write_dex_retargeting),
        ),
        _hand_format("mano", "MANO's parameters", ".mano.npz", write_mano_parameters, hand="mano"),
        _scene_format("rerun", "a recording for the Rerun viewer", ".rrd", write_rerun, ("rerun", "rerun")),
    )
}  # fmt: skip
"""Every format by its name, in the order in which they are offered."""
