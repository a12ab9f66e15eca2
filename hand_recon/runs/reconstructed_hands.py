"""Reconstructed hands as a Python program gets them: arrays, drawings and files."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from hand_recon.fitting.drawing import PHOTO_STYLE, drawn_hand, save_meshes
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hand_records import HandRecords, joined_records
from hand_recon.fitting.hands_file import hand_entries, writing_hands
from hand_recon.fitting.images import contact_sheet, draw_fitted, fitted_image
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.fitting.results import IMAGE_SUFFIXES, ResultOptions, write_image, write_results
from hand_recon.rendering.mesh_files import MESH_SUFFIXES
from hand_recon.visualization.hand_overlay import draw_hands


@dataclass(frozen=True)
class ReconstructedHands:
    """3D hands as NumPy arrays, a row per hand; numbers of hands without a result are NaN."""

    parts: tuple[FittedHands, ...] = field(repr=False)
    """Fitted hands in their order, in parts."""
    faces: Int[np.ndarray, "face 3"] = field(repr=False)
    """Triangles of a right hand's mesh; reverse them for a left hand."""
    photos: tuple[UInt8[np.ndarray, "_ _ 3"], ...] = field(default=(), repr=False)
    """Photographs that the hands were found in, RGB; none for hands fitted to given landmarks."""
    photo_of_hand: tuple[int, ...] = ()
    """Index of each hand's photograph."""

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    @cached_property
    def records(self) -> HandRecords:
        """Everything that a file of hands says: scores, cameras, residuals, verdicts and the rest.

        Raises:
            ValueError: There is no hand.
        """
        return joined_records([to_records(part) for part in self.parts])

    @property
    def fitted(self) -> Bool[np.ndarray, " hand"]:
        """Mask of the hands that had enough landmarks and a finite result."""
        return self.records.fitted if len(self) else np.zeros(0, dtype=bool)

    @property
    def sides(self) -> tuple[str, ...]:
        """Side of each hand, `left` or `right`."""
        return self.records.sides if len(self) else ()

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Verdict on each hand, `plausible`, `doubtful` or `not fitted`; the reasons are in `records`."""
        return self.records.verdicts if len(self) else ()

    @property
    def vertices(self) -> Float[np.ndarray, "hand vertex 3"]:
        """Mesh vertices, camera frame (x right, y down, z forward), metres."""
        if not len(self):
            return np.zeros((0, int(self.faces.max()) + 1, 3))
        return np.concatenate([part.prediction.vertices.numpy() for part in self.parts])

    @property
    def landmarks_3d(self) -> Float[np.ndarray, "hand landmark=21 3"]:
        """Landmarks, camera frame, metres."""
        return self.records.landmarks_3d if len(self) else np.zeros((0, 21, 3))

    @property
    def landmarks_2d(self) -> Float[np.ndarray, "hand landmark=21 2"]:
        """Projections of `landmarks_3d`, pixels of the image."""
        return self.records.landmarks_2d if len(self) else np.zeros((0, 21, 2))

    @property
    def joint_angles_degrees(self) -> Float[np.ndarray, "hand joint=15 axis=3"]:
        """Bend, splay and twist of each joint of `hand_recon.hand.skeleton.ARTICULATED`, degrees."""
        return self.records.joint_angles_degrees if len(self) else np.zeros((0, 15, 3))

    def entries(self) -> list[dict[str, Any]]:
        """The hands as the objects of `hands.json`."""
        return list(hand_entries(self.records)) if len(self) else []

    def draw(
        self, path: str | Path | None = None, panel: int = 224
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Draw the hands: over their photograph, or, of given landmarks, a row of panels per hand.

        Of several photographs, the drawings are one below the other.

        Args:
            path: File to write, `.png` or `.jpg`; not overwritten. None to write none.
            panel: Side of each panel of a row, pixels.

        Returns:
            The drawing, RGB.

        Raises:
            FileExistsError: The file is there already.
            ValueError: No hand was fitted.
        """
        target = None if path is None else _free(path)
        if target is not None and target.suffix.lower() not in IMAGE_SUFFIXES:
            raise ValueError(f"{target} names no kind of image; expected .png or .jpg.")
        if not self.fitted.any():
            raise ValueError("No hand was fitted, so that there is nothing to draw.")
        drawing = self._over_photos() if self.photos else self._rows(panel)
        if target is not None:
            write_image(target, drawing)
        return drawing

    def _rows(self, panel: int) -> UInt8[np.ndarray, "height width 3"]:
        rows, captions, number = [], [], 0
        for part in self.parts:
            for position, fitted in enumerate(part.fitted.tolist()):
                if fitted:
                    one = fitted_image(part, position, number)
                    captions.append(one.caption)
                    rows.append(draw_fitted(one, self.faces, panel))
                number += 1
        return contact_sheet(rows, captions)

    def _over_photos(self) -> UInt8[np.ndarray, "height width 3"]:
        drawings, vertices, fitted = [], self.vertices, self.fitted
        for photo, pixels in enumerate(self.photos):
            hands = [hand for hand, of in enumerate(self.photo_of_hand) if of == photo]
            drawn = [
                drawn_hand(self.records, vertices, hand, str(number))
                for number, hand in enumerate(hands, start=1)
                if fitted[hand]
            ]
            drawings.append(draw_hands(pixels, drawn, self.faces, PHOTO_STYLE))
        width = max(one.shape[1] for one in drawings)
        return np.concatenate(
            [
                np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0)), constant_values=255)
                for one in drawings
            ]
        )

    def save(self, path: str | Path, options: ResultOptions | None = None) -> Path:
        """Write the hands to a file by its suffix, or to a folder.

        `.obj`, `.ply` and `.glb` hold the meshes, `.json` is a file of hands; a name without one of these
        suffixes is a folder, which gets what `hand-recon fit` writes.

        Args:
            path: The file or folder; nothing is overwritten.
            options: How much is written to a folder.

        Raises:
            FileExistsError: The file is there already, or the folder already holds results.
            ValueError: No hand was fitted.
        """
        path = Path(path).expanduser()
        suffix = path.suffix.lower()
        if suffix == ".json":
            with writing_hands(_free(path)) as write:
                if len(self):
                    write(self.records)
        elif suffix in MESH_SUFFIXES:
            self._save_meshes(_free(path))
        elif suffix and not path.is_dir():
            raise ValueError(
                f"{path} has the suffix {path.suffix}; expected .json, .obj, .ply, .glb or a folder's name "
                "without a suffix."
            )
        else:
            write_results(path, self.parts, torch.from_numpy(self.faces), options)
        return path

    def _save_meshes(self, path: Path) -> None:
        if not self.fitted.any():
            raise ValueError("No hand was fitted, so that there is no mesh to save.")
        sides = [side for side, fitted in zip(self.sides, self.fitted, strict=True) if fitted]
        save_meshes(path, self.vertices[self.fitted], sides, self.faces)


def _free(path: str | Path) -> Path:
    path = Path(path).expanduser()
    if path.exists():
        raise FileExistsError(f"{path} exists, and nothing is overwritten; name another file.")
    return path


def image_inputs(images: Any) -> Sequence[Any]:  # noqa: ANN401  # a file, an array, or several
    """Images as a list, for one image or several.

    Args:
        images: A file name, an RGB array, something that NumPy takes for one (such as Pillow's images), or a
            list of these.
    """
    return list(images) if isinstance(images, list | tuple) else [images]
