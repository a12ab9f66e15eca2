"""A dataset whose images and labels are their own index."""

import torch

from hand_recon.schema import HandSample


class NumberedHands:
    """Dataset of hands whose image has their index as its only grey value."""

    def __init__(self, count: int, with_3d: bool = True) -> None:
        self.count = count
        self.with_3d = with_3d

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> HandSample:
        return HandSample(
            image=torch.full((3, 16, 16), index, dtype=torch.uint8),
            landmarks_2d=torch.full((21, 2), 8.0),
            labelled=torch.ones(21, dtype=torch.bool),
            index=index,
            source=f"number {index}",
            landmarks_3d=torch.full((21, 3), float(index)) if self.with_3d else None,
        )
