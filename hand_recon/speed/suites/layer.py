"""Hand layer, forward and backward, against the published formulas and smplx's MANO layer."""

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import PARENTS, ROOT_JOINT
from hand_recon.regressor.compiling import compiler_problem, one_graph
from hand_recon.schema import HandGeometry
from hand_recon.speed.measurement import Settings, interleaved, ratios, spread
from hand_recon.speed.poses import blended_hand, joint_angles, shapes
from hand_recon.speed.published.hand_layer import PublishedLayer
from hand_recon.speed.rows import LeftOut, Row, hands

Layer = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""Joint rotations and shape → vertices and rotation centres."""

BATCHES = (1, 64, 1024)
WANTED = {"eager": (1.5, 2.5, 2.0), "compiled": (3.0, 5.0, 3.0)}
"""Times as fast as smplx's layer, by batch."""


def measure(settings: Settings) -> Iterator[Row | LeftOut]:
    """Time the layer eager and compiled, from joint rotations to vertices and rotation centres."""
    hand = blended_hand().to(settings.device)
    layers: dict[str, Layer] = {"eager": _ours(hand.pose), "published": PublishedLayer(hand)}
    problem = "quick=true" if settings.quick else compiler_problem(settings.device)
    if problem is None:
        layers["compiled"] = one_graph(_ours(hand.pose))
    else:
        yield LeftOut("layer", "compiled layer", problem)
    if importlib.util.find_spec("smplx") is None:
        yield LeftOut("layer", "comparison with smplx", "smplx is not installed")
    else:
        layers["smplx"] = _smplx(hand)
    for place, batch in enumerate(BATCHES[:2] if settings.quick else BATCHES):
        yield from _compared(hand, layers, batch, place, settings)


def _ours(pose: Callable[..., HandGeometry]) -> Layer:
    def layer(rotations: Tensor, shape: Tensor) -> tuple[Tensor, Tensor]:
        geometry = pose(rotations, shape)
        return geometry.vertices, geometry.joints

    return layer


def _compared(
    hand: HandModel, layers: dict[str, Layer], batch: int, place: int, settings: Settings
) -> Iterator[Row]:
    """Rows of one batch size, each of our layers against each reference."""
    rotations = joint_rotations(
        joint_angles("natural", batch).to(hand.frames), hand.frames, hand.rest_angles
    ).requires_grad_()
    shape = shapes(batch).to(hand.template).requires_grad_()
    values = {name: _gradients(layer, rotations, shape) for name, layer in layers.items()}
    works = {
        name: lambda layer=layer: _gradients(layer, rotations, shape)
        for name, layer in layers.items()
    }
    times = interleaved(works, settings)
    for ours in ("eager", "compiled"):
        for other in ("published", "smplx"):
            if ours in times and other in times:
                yield Row(
                    suite="layer",
                    work=f"{ours} hand layer",
                    size=hands(batch),
                    items=batch,
                    seconds=spread(times[ours]),
                    reference={"published": "published formulas", "smplx": "smplx's MANO layer"}[
                        other
                    ],
                    reference_seconds=spread(times[other]),
                    ratio=ratios(times[other], times[ours]),
                    wanted_ratio=WANTED[ours][place] if other == "smplx" else None,
                    difference=_difference(values[ours], values[other]),
                )


def _gradients(layer: Layer, rotations: Tensor, shape: Tensor) -> tuple[Tensor, ...]:
    """Vertices, centres and the gradients of a sum of squares."""
    rotations.grad = shape.grad = None
    vertices, joints = layer(rotations, shape)
    (vertices.square().sum() + joints.square().sum()).backward()
    assert rotations.grad is not None  # noqa: S101  # just computed
    return vertices.detach(), joints.detach(), rotations.grad


def _difference(ours: tuple[Tensor, ...], other: tuple[Tensor, ...]) -> str:
    """Largest difference of a vertex's coordinate from the reference's."""
    return f"{float((ours[0] - other[0]).abs().max()):.0e} m"


def _smplx(hand: HandModel) -> Layer:
    """MANO layer of the package smplx over the same arrays."""
    smplx = importlib.import_module("smplx")

    model = smplx.MANOLayer(
        model_path="", data_struct=_mano_like(hand), use_pca=False, num_pca_comps=45, num_betas=10
    ).to(hand.template)
    identity = torch.eye(3).to(hand.template)

    def layer(rotations: Tensor, shape: Tensor) -> tuple[Tensor, Tensor]:
        root = identity.expand(len(shape), 1, 3, 3)
        output: Any = model(betas=shape, global_orient=root, hand_pose=rotations)
        joints = output.joints
        return output.vertices - joints[:, ROOT_JOINT, None], joints - joints[:, ROOT_JOINT, None]

    return layer


def _mano_like(hand: HandModel) -> SimpleNamespace:
    """Arrays of a hand model under the names of MANO's file."""
    assert hand.pose_directions is not None  # noqa: S101  # the blended hand has them
    # Weights over the vertices that give each rotation centre, at rest and along every direction of shape.
    surface = _columns(hand.template, hand.shape_directions)
    centres = _columns(hand.joints_template, hand.joint_shape_directions)
    return SimpleNamespace(
        f=hand.faces.cpu().numpy(),
        v_template=hand.template.cpu().double().numpy(),
        shapedirs=hand.shape_directions.cpu().numpy(),
        posedirs=hand.pose_directions.cpu().numpy(),
        J_regressor=centres @ np.linalg.pinv(surface),
        kintree_table=np.stack([np.array([2**32 - 1, *PARENTS[1:]]), np.arange(len(PARENTS))]),
        weights=hand.skinning_weights.cpu().numpy(),
        hands_components=np.eye(45),
        hands_mean=np.zeros(45),
    )


def _columns(points: Tensor, directions: Tensor) -> np.ndarray:
    """Coordinates, one, and displacements of points, a row per point."""
    columns = [points, torch.ones_like(points[:, :1]), directions.flatten(1)]
    joined: np.ndarray = torch.cat(columns, dim=1).cpu().double().numpy()
    return joined
