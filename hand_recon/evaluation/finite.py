"""Refusal of predictions that are not finite (Sec. 4.1)."""

from jaxtyping import Shaped
from torch import Tensor


def require_finite(name: str, values: Shaped[Tensor, "sample ..."], index: Tensor) -> None:
    """Refuse predictions that are not finite.

    Args:
        name: The values' name in the message.
        values: One row per sample.
        index: Number of each sample, for the message.

    Raises:
        ValueError: Some values are not finite; the message names their samples.
    """
    # Quicker than to look at each; the sum of finite numbers may overflow, and then each is looked at.
    if values.sum().isfinite():
        return
    broken = ~values.flatten(start_dim=1).isfinite().all(dim=1)
    if broken.any():
        raise ValueError(
            f"The predicted {name} of the samples {some(index[broken.to(index.device)])} are not "
            "finite; only finite predictions have scores. Check these inputs and the model's weights."
        )


def some(index: Tensor) -> str:
    """The first ten of some numbers, and how many more there are, for messages."""
    shown = [str(value) for value in index.tolist()[:10]]
    return ", ".join(shown) + (f" and {len(index) - 10} more" if len(index) > 10 else "")
