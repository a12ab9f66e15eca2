"""Results in part files: each is complete or absent, and none is written twice."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from hand_recon import __version__
from hand_recon.formats.new_file import refuse_existing
from hand_recon.scale.extra import arrow_module, parquet_module

MANIFEST: Final = "manifest.json"
"""File of a complete folder: input, settings, parts and counts."""

PARTS: Final = "hands"
"""Folder of the part files, which holds nothing else, so that it is read as one table."""

UNFINISHED: Final = ".unfinished"
"""Ending of a part file that is being written; its name also begins with a dot, so that readers of Parquet
folders leave it out."""

_COUNTED: Final = ("hands", "error")


class PartFiles:
    """Part files of a folder: rows are collected until a part has all of its own, and written then."""

    def __init__(self, folder: Path, rows: int, size: int) -> None:
        """Look which parts are there, and remove what a killed command left of others.

        Args:
            folder: Folder of the parts, which no other command writes to.
            rows: Number of rows of all parts.
            size: Rows of a part; the last may have fewer.

        Raises:
            ValueError: A part file has another number of rows.
        """
        self.folder, self.rows, self.size = folder, rows, size
        self.count = -(-rows // size)
        self.collected: dict[int, list[Any]] = {}
        self.seen: dict[int, set[int]] = {}
        for left in folder.glob(f".part-*{UNFINISHED}"):
            left.unlink()
        self.done = {part for part in range(self.count) if self._is_whole(part)}

    def path(self, part: int) -> Path:
        """File of a part."""
        return self.folder / f"part-{part:05d}.parquet"

    def missing(self) -> list[int]:
        """Parts that are not there."""
        return [part for part in range(self.count) if part not in self.done]

    def expected(self, part: int) -> range:
        """Numbers of the rows of a part."""
        return range(part * self.size, min((part + 1) * self.size, self.rows))

    def add(self, batch: Any) -> Iterator[int]:  # noqa: ANN401  # pyarrow.Table
        """Collect rows, and write the parts that they complete; a row that came before is left out.

        Args:
            batch: Table with the column `row`, the number of each row, in any order.

        Yields:
            Each part that was written.
        """
        by_part: dict[int, list[int]] = {}
        for place, row in enumerate(batch.column("row").to_pylist()):
            part = row // self.size
            seen = self.seen.setdefault(part, set())
            if part not in self.done and row not in seen:
                seen.add(row)
                by_part.setdefault(part, []).append(place)
        for part, places in by_part.items():
            self.collected.setdefault(part, []).append(batch.take(places))
            if len(self.seen[part]) == len(self.expected(part)):
                self._write(part)
                yield part

    def forget(self) -> None:
        """Drop the rows of parts that are not complete: they are made again."""
        self.collected.clear()
        self.seen.clear()

    def _write(self, part: int) -> None:
        table = arrow_module().concat_tables(self.collected.pop(part)).sort_by("row")
        del self.seen[part]
        final = self.path(part)
        unfinished = final.with_name(f".{final.name}{UNFINISHED}")
        refuse_existing([final])
        told = {**(table.schema.metadata or {}), b"hand_recon": __version__.encode()}
        parquet_module().write_table(
            table.replace_schema_metadata(told), unfinished, compression="zstd"
        )
        with unfinished.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(unfinished, final)
        self.done.add(part)

    def _is_whole(self, part: int) -> bool:
        path = self.path(part)
        if not path.exists():
            return False
        found = parquet_module().read_table(path, columns=["row"]).column("row").to_pylist()
        if found != list(self.expected(part)):
            raise ValueError(
                f"{path} has {len(found)} rows that are not those of this part; expected rows "
                f"{self.expected(part).start} to {self.expected(part).stop - 1}. It is no file of this "
                "command: move it elsewhere."
            )
        return True

    def summary(self) -> dict[str, int]:
        """Numbers of images, of those that failed, of hands, of fitted and of doubtful ones, in all parts."""
        counts = Counter(images=0, failed=0, hands=0, fitted=0, doubtful=0)
        for part in sorted(self.done):
            table = parquet_module().read_table(self.path(part), columns=list(_COUNTED))
            counts.update(_counts(table))
        return dict(counts)


def _counts(table: Any) -> dict[str, int]:  # noqa: ANN401  # pyarrow.Table
    hands = table.column("hands").combine_chunks().flatten()
    verdicts: Sequence[str] = hands.field("verdict").to_pylist() if len(hands) else ()
    by_verdict = Counter(verdicts)
    return {
        "images": table.num_rows,
        "failed": table.num_rows - table.column("error").null_count,
        "hands": len(verdicts),
        "fitted": len(verdicts) - by_verdict["not fitted"],
        "doubtful": by_verdict["doubtful"],
    }
