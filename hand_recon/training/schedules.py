"""Learning-rate schedules for training from random weights (`optimizer=adamw`); the paper keeps its rate."""

import math

import torch


def warmup_cosine(
    optimizer: torch.optim.Optimizer, total_steps: int, warmup_steps: int = 100
) -> torch.optim.lr_scheduler.LambdaLR:
    """Linear warm-up of the learning rate, then a cosine to zero at the end of the run.

    The warm-up is counted in steps, not as a share of the run, because even a short run must not move the
    hand out of the image with its first steps.

    Args:
        optimizer: The optimizer; its learning rates are the highest that are reached.
        total_steps: Steps of the run.
        warmup_steps: Steps of the warm-up; 0 for none.

    Raises:
        ValueError: `warmup_steps` is negative.
    """
    if warmup_steps < 0:
        raise ValueError(f"warmup_steps={warmup_steps}; expected 0, for no warm-up, or more.")

    def factor(step: int) -> float:
        rise = min(1.0, (step + 1) / max(warmup_steps, 1))
        return rise * 0.5 * (1 + math.cos(math.pi * min(1.0, step / total_steps)))

    return torch.optim.lr_scheduler.LambdaLR(optimizer, factor)
