"""Growth of the cost with the number of hands: hand layer, all knowledge, fit."""

from collections.abc import Iterator
from functools import partial

import torch

from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandParameters
from hand_recon.speed.measurement import Settings, interleaved, spread
from hand_recon.speed.poses import joint_angles, shapes
from hand_recon.speed.rows import Row, hands

BATCHES = (1, 4, 16, 64, 256, 1024)


def measure(settings: Settings) -> Iterator[Row]:
    """Time hand and knowledge, forward and backward, over batch sizes."""
    for batch in BATCHES[:4] if settings.quick else BATCHES:
        works = {
            name: knowledge_work(batch, settings.device, name) for name in ("hand", "all knowledge")
        }
        for name, times in interleaved(works, settings).items():
            yield Row(
                suite="scaling",
                work=name,
                size=hands(batch),
                items=batch,
                seconds=spread(times),
            )


def knowledge_work(count: int, device: str, name: str) -> partial[float]:
    """Make the work of the hand alone, or of the hand and the whole prior, forward and backward.

    Args:
        count: Number of hands.
        device: Device of torch.
        name: `hand` or `all knowledge`.
    """
    hand = open_hand().to(device)
    prior = Prior.default(hand).to(device)
    angles = joint_angles("natural", count).to(device).requires_grad_()
    shape = shapes(count).to(device).requires_grad_()

    upright = torch.eye(3, device=device).expand(count, 3, 3)

    def work() -> float:
        angles.grad = shape.grad = None
        geometry = hand(angles, shape)
        loss = geometry.vertices.square().sum()
        if name != "hand":
            parameters = HandParameters(angles, shape, upright, geometry.joints[:, 0])
            values = prior.weighted(prior(parameters, geometry.vertices))
            loss = loss + sum(value.sum() for value in values.values())
        loss.backward()
        return float(loss.detach())

    return partial(work)
