"""Results that the page may ask for again, such as for a download; the oldest are forgotten."""

import itertools
import secrets
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.page.posed_files import PlayedFrame
from hand_recon.page.row_fits import GivenHands, PosedRecords

FILE_ROW: Final = "file"
"""Key of the only row of a file of hands."""

MOST: Final = 12
"""Results that are kept."""


class ForgottenError(LookupError):
    """A request for a result that is not kept; the text says what to do."""


@dataclass(frozen=True)
class KeptResult:
    """One result."""

    name: str
    """Name of the file that it was made of."""
    rows: dict[str, PosedRecords]
    """Hands by the row's key, of the rows that are fitted."""
    given: GivenHands | None = None
    """Landmarks that the rows are fitted to; None for a file of hands, and where there is no hand."""
    played: HandRecords | None = None
    """Hands of a file of hands; None for anything else."""
    frames: tuple[PlayedFrame, ...] = ()
    """Frames of a file of hands."""

    def records(self, row: str) -> HandRecords | None:
        """Hands of a row; None if there is no such row, or it is not fitted.

        Args:
            row: The row's key; `FILE_ROW` for a file of hands.
        """
        if row == FILE_ROW:
            return self.played
        return self.rows[row].records if row in self.rows else None


@dataclass
class KeptResults:
    """The latest results by number."""

    results: OrderedDict[int, KeptResult] = field(default_factory=OrderedDict)
    """Results, the oldest first."""
    numbers: "itertools.count[int]" = field(
        default_factory=lambda: itertools.count(secrets.randbits(48))
    )
    """Numbers of results to come.

    They begin anywhere, since a page that is still open may ask a new process for results of the one before,
    and must not be given those of another file.
    """

    def add(self, result: KeptResult) -> int:
        """Keep a result.

        Args:
            result: The result.

        Returns:
            Its number.
        """
        number = next(self.numbers)
        self.results[number] = result
        while len(self.results) > MOST:
            self.results.popitem(last=False)
        return number

    def __getitem__(self, number: int) -> KeptResult:
        if number not in self.results:
            raise ForgottenError(
                f"Result {number} is not kept any more; the last {MOST} are. Give the file again."
            )
        return self.results[number]
