"""Skinned, animated hands as a USD stage, for Omniverse, Isaac Sim, Houdini, Maya and Blender (`usd-core`).

Every hand is a `SkelRoot` with a mesh of its shape, a `Skeleton` of 16 joints that fits it, and a
`SkelAnimation` with the rotations of all joints and the wrist's translation at each frame. The stage has y up
and metres; the camera is at its origin and looks along −z. A second is `timeCodesPerSecond` codes. A hand is
invisible where it is not in the clip. What linear blend skinning of four joints per vertex cannot hold of a
hand model is left out, as in the animated GLB.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hand_recon.formats.exported_hands import ExportedHand, Scene
from hand_recon.formats.hand_colours import hand_colours
from hand_recon.formats.joint_motion import (
    SINGLE_FRAME,
    Rig,
    check_motions,
    motion_of,
    rig_of,
    to_quaternions,
)
from hand_recon.formats.new_file import free_place
from hand_recon.formats.skin import INFLUENCES, strongest
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS
from hand_recon.motion.trajectory import Trajectory
from hand_recon.rendering.mesh import vertex_normals

if TYPE_CHECKING:
    from pxr import Usd, UsdSkel

ROOT: Final = "/hands"
"""Path of the prim above all hands."""


def write_usd(path: str | Path, scene: Scene, hand: HandModel) -> Path:
    """Write the hands of a scene; folders are made.

    Args:
        path: File to write, `.usdc` (binary) or `.usda` (text).
        scene: The hands.
        hand: Model of the right hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: There is no hand, a hand has no frame, numbers are not finite, or a time is negative.
    """
    from pxr import Usd, UsdGeom

    check_motions(scene.trajectories)
    path = free_place(path)
    rate = _rate(scene)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(rate * max(scene.frames.values()))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, ROOT).GetPrim())
    for one, colour in zip(scene.hands, hand_colours(scene.trajectories), strict=True):
        _add_hand(stage, one, hand, colour)
        _hide(stage, one, rate)
    stage.GetRootLayer().Export(str(path))
    return path


def _rate(scene: Scene) -> float:
    """Time codes per second: frames per second, a whole number if they nearly are one."""
    steps = np.concatenate([np.diff(one.times) / np.diff(one.frames) for one in scene.trajectories])
    rate = 1 / float(np.median(steps)) if len(steps) else 1 / SINGLE_FRAME
    return float(round(rate)) if abs(rate - round(rate)) < 0.01 else rate


def _add_hand(
    stage: "Usd.Stage", one: ExportedHand, hand: HandModel, colour: tuple[float, float, float]
) -> None:
    """Add the root, mesh, skeleton and animation of a hand."""
    from pxr import UsdSkel

    rig = rig_of(one.trajectory, hand)
    root = UsdSkel.Root.Define(stage, f"{ROOT}/{one.name}")
    skeleton = _add_skeleton(stage, f"{root.GetPath()}/skeleton", rig)
    animation = _add_animation(stage, f"{root.GetPath()}/motion", one.trajectory, hand)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    mesh = _add_mesh(stage, f"{root.GetPath()}/skin", rig, colour)
    bound = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    bound.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    influences, weights = strongest(rig.weights)
    bound.CreateJointIndicesPrimvar(constant=False, elementSize=INFLUENCES).Set(
        influences.astype(np.int32).ravel()
    )
    bound.CreateJointWeightsPrimvar(constant=False, elementSize=INFLUENCES).Set(weights.ravel())
    bound.CreateGeomBindTransformAttr().Set(_matrix(np.zeros(3)))


def _add_skeleton(stage: "Usd.Stage", path: str, rig: Rig) -> "UsdSkel.Skeleton":
    """Add the skeleton at rest; joints are named by their paths."""
    from pxr import UsdSkel

    skeleton = UsdSkel.Skeleton.Define(stage, path)
    bones = rig.joints - rig.joints[np.maximum(PARENTS, 0)]
    bones[0] = rig.joints[0]
    skeleton.CreateJointsAttr(joint_paths())
    skeleton.CreateBindTransformsAttr([_matrix(place) for place in rig.joints])
    skeleton.CreateRestTransformsAttr([_matrix(bone) for bone in bones])
    return skeleton


def _add_animation(
    stage: "Usd.Stage", path: str, trajectory: Trajectory, hand: HandModel
) -> "UsdSkel.Animation":
    """Add the rotations and places of all joints."""
    from pxr import Gf, UsdSkel, Vt

    animation = UsdSkel.Animation.Define(stage, path)
    animation.CreateJointsAttr(joint_paths())
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(JOINTS)))
    rotations, translations = animation.CreateRotationsAttr(), animation.CreateTranslationsAttr()
    rig, motion = rig_of(trajectory, hand), motion_of(trajectory, hand)
    bones = rig.joints - rig.joints[np.maximum(PARENTS, 0)]
    quaternions = to_quaternions(motion.rotations)
    rate = stage.GetTimeCodesPerSecond()
    for frame, time in enumerate(trajectory.times.tolist()):
        bones[0] = motion.wrist[frame]
        values = [Gf.Quatf(w, x, y, z) for x, y, z, w in quaternions[frame].tolist()]
        rotations.Set(Vt.QuatfArray(values), rate * time)
        translations.Set(Vt.Vec3fArray.FromNumpy(bones.astype(np.float32)), rate * time)
    return animation


def _add_mesh(stage: "Usd.Stage", path: str, rig: Rig, colour: tuple[float, float, float]) -> Any:  # noqa: ANN401  # pxr is imported late
    """Add the surface at rest."""
    from pxr import Gf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(rig.vertices.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(np.full(len(rig.faces), 3, dtype=np.int32))
    mesh.CreateFaceVertexIndicesAttr(rig.faces.astype(np.int32).ravel())
    normals = vertex_normals(rig.vertices, rig.faces).astype(np.float32)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    mesh.CreateDisplayColorAttr([Gf.Vec3f(*(value / 255 for value in colour))])
    return mesh


def _hide(stage: "Usd.Stage", one: ExportedHand, rate: float) -> None:
    """Make a hand invisible before its first frame, after its last, and in gaps between them."""
    from pxr import UsdGeom

    visibility = UsdGeom.Imageable.Get(stage, f"{ROOT}/{one.name}").CreateVisibilityAttr()
    codes, numbers = rate * one.trajectory.times, one.trajectory.frames
    if codes[0] > 0:
        visibility.Set(UsdGeom.Tokens.invisible, 0.0)
    visibility.Set(UsdGeom.Tokens.inherited, float(codes[0]))
    for gap in np.flatnonzero(np.diff(numbers) > 1):
        gone = float(codes[gap]) + 1.0
        # Where times are uneven, a gap can be shorter than the time for which a frame is shown.
        if gone < codes[gap + 1]:
            visibility.Set(UsdGeom.Tokens.invisible, gone)
        visibility.Set(UsdGeom.Tokens.inherited, float(codes[gap + 1]))
    if codes[-1] + 1.0 < stage.GetEndTimeCode() + 0.5:
        visibility.Set(UsdGeom.Tokens.invisible, float(codes[-1]) + 1.0)


def joint_paths() -> list[str]:
    """Paths of the joints in a skeleton, such as `wrist/index_MCP`."""
    paths: list[str] = []
    for name, parent in zip(JOINTS, PARENTS, strict=True):
        token = name.replace(" ", "_")
        paths.append(f"{paths[parent]}/{token}" if parent >= 0 else token)
    return paths


def _matrix(place: np.ndarray) -> Any:  # noqa: ANN401  # pxr is imported late
    """A translation; USD's matrices multiply row vectors."""
    from pxr import Gf

    return Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*place.tolist()))
