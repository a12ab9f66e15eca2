"""Benchmark of the knowledge losses, against the published recipe for non-penetration and a ResNet-50.

`python -m tools.benchmark_knowledge`. The published recipe computes the winding number of every vertex by
broadcasting and the distances between all vertices, one hand at a time "because of memory". Every time is
the shortest of several runs in a separate process; memory is the growth of that process at its peak.
"""

import argparse
import math
import multiprocessing
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import torch
import torchvision
from torch import Tensor

from hand_recon.camera import default_intrinsics, project, raw_to_translation, six_d_to_rotation
from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.closed_parts import closed_parts, geodesic_distances
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters
from tests.support import knowledge_reference

Work = Callable[[], float]

NAIVE_HANDS: Final = 4
"""Number of hands that the published recipe is run on; its time per hand does not depend on it."""
RESNET_IMAGES: Final = 16
"""Images per batch of the network; its time per image hardly depends on it."""
NEAR, TOLERANCE = 0.02, 0.006


@dataclass(frozen=True)
class Cost:
    """Time and memory of a measured function, and the loss that it computed."""

    seconds: float
    megabytes: float
    value: float


def joint_angles(kind: str, count: int) -> Tensor:
    """Joint angles of gestures (`natural`), or normally distributed about all axes, SD 34° (`wild`)."""
    random = np.random.default_rng(0)
    if kind == "natural":
        return torch.tensor(np.stack([sample_pose(random) for _ in range(count)])).float()
    return torch.tensor(random.normal(scale=0.6, size=(count, 15, 3))).float()


def posed(hand: HandModel, kind: str, count: int) -> Tensor:
    """Vertices of hands in such poses and of random shapes."""
    shapes = torch.randn(count, 10, generator=torch.Generator().manual_seed(0))
    return hand(joint_angles(kind, count), shapes).vertices


def published_recipe(vertices: Tensor, triangles: Tensor, near: Tensor) -> Tensor:
    """Eq. 4 of one hand, as it is written, by broadcasting.

    Args:
        vertices: Vertices of the hand, then the centre of its wrist, metres.
        triangles: Triangles of the closed surface.
        near: Mask of the pairs of vertices that are close along the surface.
    """
    skin = vertices[:-1]
    with torch.no_grad():
        rays = vertices[triangles][None] - skin[:, None, None]
        a, b, c = rays.unbind(dim=2)
        long_a, long_b, long_c = rays.norm(dim=-1).unbind(dim=2)
        volume = (a * torch.linalg.cross(b, c)).sum(dim=-1)
        flatness = long_a * long_b * long_c + (a * b).sum(dim=-1) * long_c
        flatness = flatness + (a * c).sum(dim=-1) * long_b + (b * c).sum(dim=-1) * long_a
        inside = torch.atan2(volume, flatness).sum(dim=1) / (2 * math.pi) > 0.99
    distances = (skin[:, None] - skin[None]).square().sum(dim=-1).masked_fill(near, torch.inf)
    nearest = distances.argmin(dim=1)
    depths = (skin - skin[nearest]).norm(dim=-1)
    return torch.where(inside, depths - TOLERANCE, 0.0).clamp(min=0).sum()


def recipe_work(kind: str, count: int) -> Work:
    """Make the published recipe's work, one hand at a time."""
    hand = open_hand()
    vertices = posed(hand, kind, count).requires_grad_()
    ring = hand.wrist_ring
    cap = torch.stack([ring, ring.roll(-1), torch.full_like(ring, len(hand.template))], dim=1)
    triangles = torch.cat([hand.faces, cap])
    distances = geodesic_distances(hand.template.double().numpy(), hand.faces.numpy())
    near = torch.from_numpy(distances <= NEAR)

    def work() -> float:
        total = 0.0
        for one in vertices:
            closed = torch.cat([one, one[ring].mean(dim=0, keepdim=True)])
            loss = published_recipe(closed, triangles, near)
            loss.backward()
            total += loss.item()
        return total

    return work


def physics_work(kind: str, count: int) -> Work:
    """Make the work of our non-penetration term on a batch."""
    hand = open_hand()
    vertices = posed(hand, kind, count).requires_grad_()
    term = NonPenetration(hand)

    def work() -> float:
        loss = term(vertices).sum()
        loss.backward()
        return loss.item()

    return work


def knowledge_work(kind: str, count: int, *, full: bool) -> Work:
    """Make the work of hand model, camera and data term on a batch; with `full`, of the prior too."""
    hand = open_hand()
    prior = Prior.default(hand)
    angles = joint_angles(kind, count).requires_grad_()
    shape = torch.randn(count, 10).requires_grad_()
    six = torch.eye(3)[:2].flatten().repeat(count, 1).requires_grad_()
    raw = torch.tensor([6.7, 0.0, 0.0]).repeat(count, 1).requires_grad_()
    intrinsics = default_intrinsics(224, shape).expand(count, 3, 3)

    def work() -> float:
        parameters = HandParameters(angles, shape, six_d_to_rotation(six), raw_to_translation(raw))
        placed = hand.to_camera(parameters)
        pixels = project(placed.landmarks, intrinsics)
        loss = (pixels - 112).square().sum()
        if full:
            values = prior.weighted(prior(parameters, placed.vertices))
            loss = loss + torch.stack([value.sum() for value in values.values()]).sum()
        loss.backward()
        return loss.item()

    return work


def resnet_work(count: int) -> Work:
    """Make the work of a ResNet-50 on images of 224 pixels."""
    network = torchvision.models.resnet50(weights=None)
    images = torch.randn(count, 3, 224, 224)

    def work() -> float:
        loss = network(images).square().mean()
        loss.backward()
        return loss.item()

    return work


def _measured(make: Callable[[], Work], threads: int, runs: int, pipe: object) -> None:
    torch.set_num_threads(threads)
    work = make()
    # By now the process has loaded its modules and tables, but not computed anything.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        value = work()
        times.append(time.perf_counter() - start)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    pipe.send(Cost(min(times), grown / 1024, value))  # type: ignore[attr-defined]


def measure(make: Callable[[], Work], threads: int, runs: int) -> Cost:
    """Measure time and memory of some work in a separate process."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_measured, args=(make, threads, runs, sender))
    process.start()
    cost: Cost = receiver.recv()
    process.join()
    return cost


def largest_difference(kind: str, count: int) -> float:
    """Largest difference between our d(v) and its definition written out in NumPy, metres."""
    hand = open_hand()
    vertices, parts = posed(hand, kind, count), closed_parts(hand)
    distances = geodesic_distances(hand.template.double().numpy(), hand.faces.numpy())
    expected = [
        knowledge_reference.depths(one.double().numpy(), parts, distances, NEAR) for one in vertices
    ]
    actual = NonPenetration(hand).depths(vertices).double().numpy()
    return float(np.abs(actual - np.stack(expected)).max())


def report_physics(batch: int, threads: int) -> None:
    """Print non-penetration against the published recipe."""
    print(f"non-penetration, forward and backward, {batch} hands, {threads} thread(s)")
    print(
        f"{'poses':8} {'recipe':>9} {'peak/hand':>10} {'ours':>9} {'peak':>7} {'faster':>7} {'leaner':>7}"
    )
    for kind in ("natural", "wild"):
        recipe = measure(partial(recipe_work, kind, NAIVE_HANDS), threads, 3)
        ours = measure(partial(physics_work, kind, batch), threads, 20)
        whole = recipe.seconds * batch / NAIVE_HANDS
        leaner = recipe.megabytes * batch / max(ours.megabytes, 1)
        print(
            f"{kind:8} {whole:7.2f} s {recipe.megabytes:7.0f} MB {ours.seconds * 1e3:6.1f} ms "
            f"{ours.megabytes:4.0f} MB {whole / ours.seconds:6.0f}x {leaner:6.0f}x"
        )
    print(
        f"  the recipe: {NAIVE_HANDS} hands, scaled; 'leaner' if it held {batch} hands at once, as ours does"
    )
    worst = max(largest_difference(kind, 8) for kind in ("natural", "wild"))
    print(f"  largest difference of our d(v) from its definition, 16 hands: {worst:.1e} m")


def report_all(batch: int, threads: int, *, resnet: bool) -> None:
    """Print all knowledge losses against the network."""
    print(f"\nhand model, camera, data term and all knowledge, forward and backward, {batch} hands")
    everything = {}
    for kind in ("natural", "wild"):
        bare = measure(partial(knowledge_work, kind, batch, full=False), threads, 20)
        everything[kind] = measure(partial(knowledge_work, kind, batch, full=True), threads, 20)
        print(
            f"{kind:8} {everything[kind].seconds * 1e3:6.1f} ms, of which hand, camera and data term "
            f"{bare.seconds * 1e3:.1f} ms"
        )
    if resnet:
        images = min(batch, RESNET_IMAGES)
        network = measure(partial(resnet_work, images), threads, 2).seconds * batch / images
        shares = ", ".join(
            f"{kind} {cost.seconds / network:.2%}" for kind, cost in everything.items()
        )
        print(f"ResNet-50 at 224 pixels, {batch} images (scaled from {images}): {network:.1f} s")
        print(f"  all of the above in per cent of it: {shares}")


def main() -> None:
    """Measure and print both comparisons."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--no-resnet", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    report_physics(arguments.batch, arguments.threads)
    report_all(arguments.batch, arguments.threads, resnet=not arguments.no_resnet)


if __name__ == "__main__":
    main()
