"""A term of the prior as a user would write it, in a package that hand_recon does not know."""

from hand_recon.knowledge.terms import ShapeTerm


class OwnTerm(ShapeTerm):
    """The shape term under another name."""
