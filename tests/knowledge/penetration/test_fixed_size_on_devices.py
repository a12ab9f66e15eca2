"""In non-penetration in lists of fixed length, no length depends on a pose, and no value is read."""

import subprocess
import sys
from typing import Any

import pytest
import torch
from torch import Tensor
from torch._subclasses.fake_tensor import DynamicOutputShapeException, FakeTensorMode
from torch.utils._pytree import tree_leaves

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.fixed_size import FixedSizeNonPenetration
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.terms import NonPenetrationTerm
from tests.support.random_surfaces import random_vertices
from tests.support.value_and_gradient import value_and_gradient
from tests.support.watched import Watched


class Shapes(Watched):
    """Records every operation with the shapes of its results."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, list[torch.Size]]] = []

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        """Record an operation."""
        shapes = [leaf.shape for leaf in tree_leaves(result) if isinstance(leaf, Tensor)]
        self.seen.append((str(operation), shapes))


def test_no_operation_and_no_shape_depends_on_the_poses(
    hand: HandModel,
) -> None:
    open_hands = hand.template.repeat(2, 1, 1)
    crossed = random_vertices(hand, 2, spread=0.8).contiguous()
    seen: dict[NonPenetration, list[object]] = {}
    by_pose, fixed = NonPenetration(hand), FixedSizeNonPenetration(hand)
    for term in (by_pose, fixed):
        seen[term] = []
        for vertices in (open_hands, crossed):
            with Shapes() as shapes:
                value_and_gradient(term, vertices)
            seen[term].append(shapes.seen)
    assert seen[fixed][0] == seen[fixed][1]
    assert seen[by_pose][0] != seen[by_pose][1]


def test_no_value_is_read_forward_or_backward(hand: HandModel) -> None:
    """On a device without values, whatever waits for one is an error."""
    vertices = torch.empty(3, 778, 3, device="meta")
    fixed = FixedSizeNonPenetration(hand).to("meta")
    loss, gradient = value_and_gradient(fixed, vertices)
    assert (loss.shape, gradient.shape) == ((3,), (3, 778, 3))
    assert fixed.depths(vertices).shape == (3, 778)
    with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
        NonPenetration(hand).to("meta")(vertices)


ONE_GRAPH = """
import torch
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.fixed_size import FixedSizeNonPenetration
from hand_recon.speed.poses import posed_surface

term = FixedSizeNonPenetration(open_hand())
found = []
# The backend that runs the graph as it is needs no compiler; a break in the graph is an error.
for run in (torch.compile(term, fullgraph=True, backend="eager", dynamic=False), term):
    vertices = posed_surface(open_hand(), "wild", 6).requires_grad_()
    loss = run(vertices)
    loss.sum().backward()
    found.append((loss.detach(), vertices.grad))
torch.testing.assert_close(*found)
assert float(found[0][0].sum()) > 0
assert term.left_out.take() == ({"candidates": 0, "tested": 0, "inside": 0, "triangles": 0}, 12)
"""


def test_it_is_one_graph() -> None:
    # Checks of shapes, which only tests have, would break the graph.
    words = [sys.executable, "-c", ONE_GRAPH]
    run = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603  # our own words
    assert run.returncode == 0, run.stderr[-2000:]


def test_on_a_gpu_auto_is_fixed(hand: HandModel) -> None:
    """A simulated GPU, which refuses lists whose length depends on values."""
    terms = {sizes: NonPenetrationTerm(hand, sizes=sizes) for sizes in ("auto", "by_pose")}
    with FakeTensorMode():
        vertices = torch.empty(3, 778, 3, device="cuda", requires_grad=True)
        for sizes, term in terms.items():
            term._apply(lambda one: torch.empty(one.shape, dtype=one.dtype, device="cuda"))  # type: ignore[no-untyped-call]
            if sizes == "by_pose":
                with pytest.raises(DynamicOutputShapeException):
                    term.non_penetration(vertices)
            else:
                assert term.non_penetration(vertices).device.type == "cuda"


def test_nothing_of_it_is_saved_and_all_of_it_moves(hand: HandModel) -> None:
    physics = FixedSizeNonPenetration(hand)
    assert physics.state_dict() == {}
    physics.to("meta")
    assert {buffer.device.type for buffer in physics.buffers()} == {"meta"}
    # The counter moves, too, but is no buffer: several processes would all be given the first one's.
    assert list(physics.left_out.buffers()) == []
    with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
        physics.left_out.take()
