"""Frozen, typed records of hands, samples, batches and predictions, with a unit on every field.

All are in metres, radians and pixels of the crop, for right hands; the camera looks along +z, x points
right, y down. `docs/conventions.md` is the full list. Joints are in MANO's order, landmarks in the order of
`hand_recon.hand.skeleton.LANDMARKS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Self

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

REFERENCE_SIZE: Final = 224
"""Side of the paper's crop, pixels; landmarks without an image are in pixels of such a crop."""


class _TensorRecord:
    """Base of records of tensors: move, detach, index and concatenate all fields at once."""

    def to(self, *args: object, **kwargs: object) -> Self:
        """Copy of the record with every tensor converted by `Tensor.to`."""
        return self._map(lambda tensor: tensor.to(*args, **kwargs))  # type: ignore[call-overload]

    def pin_memory(self) -> Self:
        """Copy of the record in page-locked memory; a DataLoader calls it before a copy to a GPU."""
        return self._map(Tensor.pin_memory)

    def detach(self) -> Self:
        """Copy of the record without gradients."""
        return self._map(Tensor.detach)

    def select(self, which: Tensor | slice) -> Self:
        """Index every tensor along its first axis."""
        return self._map(lambda tensor: tensor[which])

    @classmethod
    def join(cls, records: Sequence[Self]) -> Self:
        """Concatenate records along their first axis; all must have the same fields present."""
        joined: dict[str, object] = {}
        for field in fields(cls):  # type: ignore[arg-type]  # every subclass is a dataclass
            values = [getattr(record, field.name) for record in records]
            if isinstance(values[0], Tensor):
                joined[field.name] = torch.cat(values)
            elif isinstance(values[0], _TensorRecord):
                joined[field.name] = values[0].join(values)
            elif isinstance(values[0], tuple):
                joined[field.name] = tuple(entry for value in values for entry in value)
            else:
                joined[field.name] = values[0]
        return cls(**joined)

    def _map(self, change: Callable[[Tensor], Tensor]) -> Self:
        changed: dict[str, object] = {}
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value = getattr(self, field.name)
            if isinstance(value, Tensor):
                changed[field.name] = change(value)
            elif isinstance(value, _TensorRecord):
                changed[field.name] = value._map(change)
        return replace(self, **changed)  # type: ignore[type-var]


@dataclass(frozen=True)
class HandParameters(_TensorRecord):
    """Pose, shape, rotation and translation of a hand: θ, β and C of Sec. 3.1."""

    joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    """Bend, splay and twist of each joint from the anatomical neutral, radians."""
    shape: Float[Tensor, "*batch direction=10"]
    """Coefficients of the shape directions, in standard deviations."""
    root_rotation: Float[Tensor, "*batch 3 3"]
    """Rotation from the hand's frame to the camera's, about the middle finger's MCP centre."""
    translation: Float[Tensor, "*batch 3"]
    """Position of the middle finger's MCP centre in the camera's frame, metres."""


@dataclass(frozen=True)
class HandEstimate(_TensorRecord):
    """A network's estimate of a hand, from which a fit can start."""

    parameters: HandParameters
    """Parameters of the right hand, or of the right hand that mirrors a left one, camera frame."""
    log_sigma: Float[Tensor, "*batch landmark=21 2"]
    """log σ of each coordinate, σ in pixels of the landmarks beside it."""
    seen_pose: Float[Tensor, "*batch joint=15 axis=3"] | None = None
    """Joint angles that the network sees in pixels alone, radians; NaN where it saw none."""


@dataclass(frozen=True)
class HandGeometry(_TensorRecord):
    """A posed hand, all points in one frame."""

    vertices: Float[Tensor, "*batch vertex 3"]
    """Metres."""
    joints: Float[Tensor, "*batch joint=16 3"]
    """Rotation centres, wrist first, metres."""
    landmarks: Float[Tensor, "*batch landmark=21 3"]
    """Landmarks in the hand model's landmark set, metres."""


@dataclass(frozen=True)
class HandSample(_TensorRecord):
    """One crop of one hand with its labels; left hands are already mirrored to right ones."""

    image: UInt8[Tensor, "3 height width"]
    """RGB; height and width are 0 for landmarks without an image, in a crop of `REFERENCE_SIZE`."""
    landmarks_2d: Float[Tensor, "landmark=21 2"]
    """Labels, pixels of the crop; NaN where there is no label."""
    labelled: Bool[Tensor, "landmark=21"]
    """True for landmarks that have a 2D label."""
    index: int
    """Index in the dataset, so that error messages can name the sample."""
    source: str
    """File or recipe of the sample."""
    intrinsics: Float[Tensor, "3 3"] | None = None
    """Camera matrix of the crop, pixels."""
    landmarks_3d: Float[Tensor, "landmark=21 3"] | None = None
    """Ground truth in the camera's frame, metres; for evaluation and 3D supervision only."""
    vertices: Float[Tensor, "vertex 3"] | None = None
    """Ground truth in the camera's frame, metres; for evaluation only."""
    occluded: Bool[Tensor, "landmark=21"] | None = None
    """True for landmarks that are occluded."""
    label_noise: Float[Tensor, "landmark=21"] | None = None
    """Standard deviation of the label's noise, pixels of the crop; known for synthetic hands."""
    confidence: Float[Tensor, "landmark=21"] | None = None
    """Detector confidence of each landmark, 0 to 1."""
    mirrored: bool = False
    """True if image and labels are mirrored from a left hand."""


@dataclass(frozen=True)
class HandBatch(_TensorRecord):
    """Stacked samples; labels that a sample lacks are NaN or masked, never zero."""

    image: UInt8[Tensor, "batch 3 height width"] | Float[Tensor, "batch 3 height width"]
    """RGB, 0–255 as bytes, or 0–1 as floats once augmented; size 0 for landmarks without images."""
    landmarks_2d: Float[Tensor, "batch landmark=21 2"]
    """Labels, pixels of the crop; NaN where there is no label."""
    labelled: Bool[Tensor, "batch landmark=21"]
    """True for landmarks that have a 2D label."""
    index: Int[Tensor, " batch"]
    """Index of each sample in its dataset."""
    source: tuple[str, ...]
    """File or recipe of each sample."""
    intrinsics: Float[Tensor, "batch 3 3"] | None = None
    """Camera matrix of the crop, pixels; None if any sample lacks one."""
    landmarks_3d: Float[Tensor, "batch landmark=21 3"] | None = None
    """Ground truth, camera frame, metres; NaN for samples without it; None if all lack it."""
    vertices: Float[Tensor, "batch vertex 3"] | None = None
    """Ground truth, camera frame, metres; NaN for samples without it; None if all lack it."""
    occluded: Bool[Tensor, "batch landmark=21"] | None = None
    """True for landmarks that are occluded; None if it is unknown for any sample."""
    label_noise: Float[Tensor, "batch landmark=21"] | None = None
    """Standard deviation of the label's noise, pixels; NaN where unknown."""
    confidence: Float[Tensor, "batch landmark=21"] | None = None
    """Detector confidence of each landmark, 0 to 1; NaN where unknown."""
    mirrored: Bool[Tensor, " batch"] | None = None
    """True for samples that are mirrored from a left hand; None if none is."""
    estimate: HandEstimate | None = None
    """A network's estimate of each hand in the camera of the crop, for fits that start from it; None without
    one."""

    def __len__(self) -> int:
        return int(self.landmarks_2d.shape[0])

    def select(self, which: Tensor | slice) -> Self:
        """Index every tensor and the sources along the first axis."""
        indices = torch.arange(len(self))[which.cpu() if isinstance(which, Tensor) else which]
        sources = tuple(self.source[index] for index in indices.tolist())
        return replace(super().select(which), source=sources)

    @property
    def crop_size(self) -> int:
        """Side of the square crop, pixels."""
        return int(self.image.shape[-1]) or REFERENCE_SIZE


@dataclass(frozen=True)
class HandPrediction(_TensorRecord):
    """The regressor's predictions for a batch of crops."""

    parameters: HandParameters
    """Pose, shape, rotation and translation."""
    vertices: Float[Tensor, "*batch vertex 3"]
    """Camera frame, metres."""
    joints: Float[Tensor, "*batch joint=16 3"]
    """Rotation centres, camera frame, metres."""
    landmarks_3d: Float[Tensor, "*batch landmark=21 3"]
    """Camera frame, metres."""
    landmarks_2d: Float[Tensor, "*batch landmark=21 2"]
    """Projections, pixels of the crop."""
    log_sigma: Float[Tensor, "*batch landmark=21 2"]
    """log σ of each coordinate, σ in pixels of a 224-pixel crop (Sec. 3.3)."""
    intrinsics: Float[Tensor, "*batch 3 3"]
    """Camera matrix of the projection, pixels of the crop."""
    correlation: Float[Tensor, "*batch landmark=21"] | None = None
    """Correlation of the errors of a landmark's two coordinates, −1 to 1; None if it is not predicted."""
    covariance_3d: Float[Tensor, "*batch landmark=21 3 3"] | None = None
    """Covariance of each landmark from the hand's origin, axes of the camera, square metres; None without
    an estimate."""
    located_2d: Float[Tensor, "*batch landmark=21 2"] | None = None
    """Landmarks that the network found in the image before it placed a hand there, pixels of the crop;
    None if it looks for none."""

    @property
    def found_2d(self) -> Float[Tensor, "*batch landmark=21 2"]:
        """Landmarks that the network found in the image; those of its hand if it looks for none."""
        return self.landmarks_2d if self.located_2d is None else self.located_2d


@dataclass(frozen=True)
class CropMotion:
    """Similarity transform of each crop of a batch and the matching rotation of the camera frame."""

    pixels: Float[Tensor, "batch 3 3"]
    """Matrix from pixels of the old crop to pixels of the new one."""
    camera: Float[Tensor, "batch 3 3"]
    """Rotation from the old camera frame to the new one, with an optional flip."""
    scale: Float[Tensor, " batch"]
    """Scale factor of lengths, new pixels per old pixel."""


def collate(samples: list[HandSample]) -> HandBatch:
    """Stack samples into a batch; `HandBatch` says which missing labels become NaN and which None.

    Raises:
        ValueError: The list is empty, or the crops differ in size.
    """
    if not samples:
        raise ValueError(
            "Found an empty list of samples, expected at least one to make a batch of."
        )
    sizes = {tuple(sample.image.shape) for sample in samples}
    if len(sizes) > 1:
        raise ValueError(
            f"Crops in one batch must have one size, found {sorted(sizes)}. "
            "Set one `crop_size` for every dataset in the mixture."
        )
    return HandBatch(
        image=torch.stack([sample.image for sample in samples]),
        landmarks_2d=torch.stack([sample.landmarks_2d for sample in samples]),
        labelled=torch.stack([sample.labelled for sample in samples]),
        index=torch.tensor([sample.index for sample in samples]),
        source=tuple(sample.source for sample in samples),
        intrinsics=_stack_if_all([sample.intrinsics for sample in samples]),
        landmarks_3d=_stack_or_nan([sample.landmarks_3d for sample in samples]),
        vertices=_stack_or_nan([sample.vertices for sample in samples]),
        occluded=_stack_if_all([sample.occluded for sample in samples]),
        label_noise=_stack_or_nan([sample.label_noise for sample in samples]),
        confidence=_stack_or_nan([sample.confidence for sample in samples]),
        mirrored=_stack_if_any([sample.mirrored for sample in samples]),
    )


def _stack_if_any(flags: list[bool]) -> Tensor | None:
    return torch.tensor(flags) if any(flags) else None


def _stack_if_all(tensors: list[Tensor | None]) -> Tensor | None:
    present = [tensor for tensor in tensors if tensor is not None]
    return torch.stack(present) if len(present) == len(tensors) else None


def _stack_or_nan(tensors: list[Tensor | None]) -> Tensor | None:
    present = [tensor for tensor in tensors if tensor is not None]
    if not present:
        return None
    missing = torch.full_like(present[0], float("nan"))
    return torch.stack([missing if tensor is None else tensor for tensor in tensors])
