"""Base class of the metrics: rows of scores per sample, so that no sample counts twice.

A distributed sampler repeats samples until every process has equally many, and a sum would count them twice.
So a metric keeps one small row per sample with the sample's index, and averages over distinct indices.
"""

from typing import Any, Final

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torchmetrics import Metric

from hand_recon.evaluation.finite import some

DISAGREEMENT: Final = 0.02
"""Largest difference of two rows of one sample, over one plus their value; rounding stays far below."""


class PerSampleMetric(Metric):
    """Metric that keeps tables with one row per sample, exact for any number of processes.

    A subclass names its tables, fills them with `record` and averages `distinct` rows in `compute`.
    Sample indices must be unique within one metric: use one metric per dataset.
    """

    full_state_update = False
    is_differentiable = False
    index: list[Int[Tensor, " sample"]]

    def __init__(self, tables: dict[str, int]) -> None:
        """Create empty tables.

        Args:
            tables: Number of columns of each table, by name.
        """
        super().__init__()
        self._tables = dict(tables)
        for name in ("index", *tables):
            self.add_state(name, default=[], dist_reduce_fx="cat")
        self._start()

    def reset(self) -> None:
        """Remove all samples."""
        super().reset()
        self._start()

    def record(self, index: Int[Tensor, " sample"], **rows: Float[Tensor, "sample _"]) -> None:
        """Append rows to some tables for the samples of an update."""
        self.index.append(index.detach().to(self.device, torch.int64))
        for name, values in rows.items():
            # Single precision is exact to 1e-7 of a value, and every accelerator has it.
            getattr(self, name).append(values.detach().to(self.device, torch.float32))

    def distinct(self, name: str) -> Float[Tensor, "sample column"]:
        """Rows of a table, the first of each sample, in double precision on the CPU.

        Raises:
            ValueError: The table lacks rows of some samples, or two rows of one sample differ.
        """
        index, rows = _joined(self.index), _joined(getattr(self, name)).double()
        if len(rows) != len(index):
            if len(rows) == 0:
                return rows
            raise ValueError(
                f"{len(index)} samples were seen, but only {len(rows)} of them have what "
                f"{type(self).__name__} needs for its {name.replace('_', ' ')}. Evaluate datasets "
                "with and without that ground truth separately."
            )
        unique, inverse = torch.unique(index, return_inverse=True)
        position = torch.arange(len(index))
        first = torch.full_like(unique, len(index)).scatter_reduce(0, inverse, position, "amin")
        self._check_agreement(rows, rows[first][inverse], index)
        return rows[first]

    def distinct_index(self) -> Int[Tensor, " sample"]:
        """Sample index of each row of `distinct`."""
        return torch.unique(_joined(self.index))

    def _check_agreement(self, rows: Tensor, expected: Tensor, index: Tensor) -> None:
        differs = ((rows - expected).abs() > DISAGREEMENT * (1 + expected.abs())).any(dim=-1)
        if differs.any():
            raise ValueError(
                f"The samples {some(index[differs].unique())} came twice with different scores: "
                "an index names more than one sample. Use one metric per dataset."
            )

    def _start(self) -> None:
        # Not empty lists: a process without samples must gather tensors of the others' type and width.
        self.index = [torch.empty(0, dtype=torch.int64, device=self.device)]
        for name, width in self._tables.items():
            setattr(self, name, [torch.empty(0, width, device=self.device)])


def _joined(parts: Any) -> Tensor:  # noqa: ANN401  # a list of tensors, or one tensor once gathered
    return (torch.cat(parts) if isinstance(parts, list) else parts).cpu()
