"""Non-penetration against the published recipe, and all knowledge beside the hand alone (Eq. 4, Sec. 3.2)."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from torch import Tensor

from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.closed_parts import closed_parts, geodesic_distances
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.speed.measurement import (
    Settings,
    Work,
    interleaved,
    peak_memory,
    ratios,
    spread,
)
from hand_recon.speed.poses import KINDS, posed_surface
from hand_recon.speed.published.depth_by_definition import depths
from hand_recon.speed.published.non_penetration import PublishedNonPenetration
from hand_recon.speed.rows import Row

BATCH = 64
FEW = 2
"""Hands that the published recipe runs on; its time per hand does not depend on their number."""
CHECKED = 8
"""Hands whose depths are compared with their definition."""
GEODESIC = 0.02


def measure(settings: Settings) -> Iterator[Row]:
    """Time both kinds of poses; memory is that of a fresh process."""
    for kind in KINDS:
        works = {
            "published": published_work(kind, FEW, settings.device),
            "ours": our_work(kind, BATCH, settings.device),
        }
        times = interleaved(works, settings)
        scale = BATCH / FEW
        times["published"] = [scale * seconds for seconds in times["published"]]
        on_processor = settings.device == "cpu" and not settings.quick
        yield Row(
            suite="physics",
            work=f"non-penetration, {kind} poses",
            size=f"{BATCH} hands",
            items=BATCH,
            seconds=spread(times["ours"]),
            reference=f"published recipe, {FEW} hands scaled",
            reference_seconds=spread(times["published"]),
            ratio=ratios(times["published"], times["ours"]),
            wanted_ratio=300.0 if settings.device == "cpu" else None,
            difference=agreement(kind),
            megabytes=_memory(our_work, kind, BATCH, settings) if on_processor else None,
            reference_megabytes=_memory(published_work, kind, 1, settings)
            if on_processor
            else None,
            note="memory of the recipe is that of one hand" if on_processor else "",
        )


def _memory(make: Callable[[str, int], Work], kind: str, count: int, settings: Settings) -> float:
    return peak_memory(partial(make, kind, count), settings.threads)


def published_work(kind: str, count: int, device: str = "cpu") -> Work:
    """Make the published recipe's work, forward and backward.

    Args:
        kind: Poses.
        count: Number of hands.
        device: Device of torch.
    """
    hand = open_hand().to(device)
    vertices = posed_surface(hand, kind, count).requires_grad_()
    return partial(_forward_and_backward, PublishedNonPenetration(hand, GEODESIC), vertices)


def our_work(kind: str, count: int, device: str = "cpu") -> Work:
    """Make the work of our non-penetration term, forward and backward.

    Args:
        kind: Poses.
        count: Number of hands.
        device: Device of torch.
    """
    hand = open_hand().to(device)
    vertices = posed_surface(hand, kind, count).requires_grad_()
    return partial(_forward_and_backward, NonPenetration(hand).to(device), vertices)


def _forward_and_backward(term: Callable[[Tensor], Tensor], vertices: Tensor) -> Tensor:
    vertices.grad = None
    loss = term(vertices).sum()
    loss.backward()
    return loss.detach()


def agreement(kind: str, count: int = CHECKED) -> str:
    """Compare the term's depths with their definition, written out vertex by vertex.

    Args:
        kind: Poses.
        count: Number of hands.

    Returns:
        Largest difference of a depth, and the number of vertices that are inside for one of the two only.
    """
    hand = open_hand()
    vertices, parts = posed_surface(hand, kind, count), closed_parts(hand)
    distances = geodesic_distances(hand.template.double().numpy(), hand.faces.numpy())
    expected = np.stack(
        [depths(one.double().numpy(), parts, distances, GEODESIC) for one in vertices]
    )
    found = NonPenetration(hand).depths(vertices).double().numpy()
    other = int(((found > 0) != (expected > 0)).sum())
    return (
        f"{np.abs(found - expected).max():.0e} m, {other} of {expected.size} vertices inside differ"
    )
