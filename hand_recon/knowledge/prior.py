"""The knowledge-encoded prior: weighted terms by name (Sec. 3.2, Eq. 5)."""

from collections.abc import Iterator, Mapping
from typing import cast

from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.knowledge.terms import NonPenetrationTerm, RangeOfMotionTerm, ShapeTerm, Term
from hand_recon.schema import HandParameters


class Prior(nn.Module):
    """A sum of weighted terms; with those of `default`, λ₁ L_pose + λ₂ L_non-penetration + λ₃ L_shape.

    Weights balance a data term that is summed over landmarks in pixels of a 224-pixel crop
    (decision 7). In a training loop of your own:

    >>> import torch
    >>> from hand_recon.hand.open_hand import open_hand
    >>> from hand_recon.schema import HandParameters
    >>> hand = open_hand()
    >>> prior = Prior.default(hand)
    >>> bent = torch.full((2, 15, 3), 0.1).requires_grad_()
    >>> parameters = HandParameters(
    ...     bent, torch.zeros(2, 10), torch.eye(3).expand(2, 3, 3), torch.zeros(2, 3)
    ... )
    >>> losses = prior.weighted(prior(parameters, hand.to_camera(parameters).vertices))
    >>> list(losses)
    ['range_of_motion', 'non_penetration', 'shape']
    >>> sum(losses.values()).mean().backward()

    Args:
        terms: The terms by name, in the order in which they are added. Those of weight zero are left out.
    """

    def __init__(self, terms: Mapping[str, Term]) -> None:
        super().__init__()
        self.terms = nn.ModuleDict({name: term for name, term in terms.items() if term.weight})

    @classmethod
    def default(cls, hand: HandModel, ranges: RangeOfMotion | str = "literature") -> "Prior":
        """Eq. 5 with every source of knowledge and the weights of Sec. 4.1, as `prior=full` has it.

        Args:
            hand: The hand model.
            ranges: The ranges of motion, or the name or path of their table (`load_ranges`).
        """
        return cls(
            {
                "range_of_motion": RangeOfMotionTerm(
                    hand, ranges=ranges, anatomy=FunctionalAnatomy()
                ),
                "non_penetration": NonPenetrationTerm(hand),
                "shape": ShapeTerm(hand),
            }
        )

    @property
    def weights(self) -> dict[str, float]:
        """The weight of every term, by name."""
        return {name: term.weight for name, term in self._items()}

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None = None
    ) -> dict[str, Float[Tensor, "*batch"]]:
        """The unweighted value of every term, one per hand, by name.

        Args:
            parameters: The hands.
            vertices: Their posed surfaces, metres. Without them, terms that need them, such as
                non-penetration, are left out: a fit adds them only once poses mean something.
        """
        return {
            name: term(parameters, vertices)
            for name, term in self._items()
            if vertices is not None or not term.needs_vertices
        }

    def weighted(self, values: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Each value times the weight of its term.

        Args:
            values: By name of the term, reduced or not.
        """
        weights = self.weights
        return {name: weights[name] * value for name, value in values.items()}

    def _items(self) -> Iterator[tuple[str, Term]]:
        for name, term in self.terms.items():
            yield name, cast("Term", term)
