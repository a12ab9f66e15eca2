"""Fuzz every reader of files from elsewhere: a clear error or a result, never a crash or a hang.

python tools/fuzz_readers.py --seconds 300 --readers hands camera

Inputs are valid files and damaged ones of `tests/support`, mutated. An input is kept for further mutations if
reading it ends at a place in the code that no earlier one ended at. There is a row for each reader. Inputs
that end in anything else than a clear error are saved in the folder of findings, and the exit status is 1.
"""

import argparse
import faulthandler
import logging
import os
import random
import re
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.fuzzed import PARSERS, Parser, outcome_of  # noqa: E402

LONGEST = 20_000
"""Bytes of an input."""
SLOW = 5.0
"""Seconds after which reading an input counts as a hang."""
HANG = 300.0
"""Seconds for 500 inputs after which the process ends with its place in the code."""
TOKENS = (
    b"null", b"NaN", b"Infinity", b"-1", b"0", b"1e400", b"1" + 400 * b"0", b"[", b"]", b"{", b"}", b'"',
    b",", b":", b"\n", b"\xff", b"\0", b"\xef\xbb\xbf", b"[[", b"]]", b"true", b'"a"', b"2147483648",
    b"&a [*a]", b"<<: *a",
    b"<a>", b"</a>", b"PK\x03\x04", b"\x93NUMPY", b"999999999999", b"-", b".", b"e", b"''", b"\\ud800",
)  # fmt: skip
"""Pieces that parsers treat specially."""


told = 2
"""Descriptor for messages about a hang, since libraries' own messages are discarded."""


@dataclass
class Row:
    """Counts of a reader."""

    executions: int = 0
    refused: int = 0
    accepted: int = 0
    findings: list[str] = field(default_factory=list)


def mutated(content: bytes, corpus: Sequence[bytes], choose: random.Random) -> bytes:
    """An input with one to four changes of bytes, pieces or halves."""
    changed = bytearray(content)
    for _ in range(choose.choice((1, 1, 2, 4))):
        place = choose.randrange(len(changed) + 1)
        length = choose.choice((1, 2, 4, 16, 200))
        kind = choose.randrange(7)
        if kind == 0 and place < len(changed):
            changed[place] ^= 1 << choose.randrange(8)
        elif kind == 1:
            del changed[place : place + length]
        elif kind == 2:
            changed[place:place] = changed[place : place + length]
        elif kind == 3:
            changed[place:place] = choose.choice(TOKENS)
        elif kind == 4:
            changed[place : place + choose.choice((1, 4, 8))] = choose.choice(TOKENS)
        elif kind == 5:
            other = choose.choice(corpus)
            start = choose.randrange(len(other) + 1)
            changed[place:] = other[start:]
        else:
            changed[place : place + length] = choose.randbytes(length)
    return bytes(changed[:LONGEST])


def fuzz(
    parser: Parser, seconds: float, most: int, seed: int, save: Callable[[bytes], Path]
) -> Row:
    """Read mutated inputs until the time or the number is used up; new ends of reading are kept."""
    choose, row, known = random.Random(seed), Row(), set[str]()  # noqa: S311
    corpus = [one[:LONGEST] for one in parser.seeds()]
    pending = list(corpus)
    until = time.monotonic() + seconds
    while row.executions < most and time.monotonic() < until:
        content = pending.pop() if pending else mutated(choose.choice(corpus), corpus, choose)
        if row.executions % 500 == 0:
            # Starting the watch takes longer than most inputs.
            faulthandler.dump_traceback_later(HANG, exit=True, file=told)
        began = time.monotonic()
        outcome = outcome_of(parser, content)
        if time.monotonic() - began > SLOW:
            outcome.finding = outcome.finding or f"it took {time.monotonic() - began:.0f} s"
        row.executions += 1
        row.accepted += outcome.accepted
        row.refused += not outcome.accepted and not outcome.finding
        # A finding's key differs from the end's: one input of an end can be slow, and the others not.
        end, finding = _alike(outcome.end), f"!{_alike(outcome.finding)}"
        if outcome.finding and finding not in known:
            known.add(finding)
            row.findings.append(f"{outcome.finding} [{save(content)}]")
        if end not in known:
            known.add(end)
            corpus.append(content)
    faulthandler.cancel_dump_traceback_later()
    return row


def _alike(text: str) -> str:
    """The text without what differs among alike findings: numbers and what is quoted."""
    return re.sub(r"\d+|'[^']*'|\"[^\"]*\"", "0", text)


def line(name: str, row: Row) -> str:
    """Row of the table."""
    return (
        f"{name:<28}{row.executions:>12,}{row.refused:>14,}{row.accepted:>12,}{len(row.findings):>10}"
        + "".join(f"\n    {one}" for one in row.findings[:20])
    )


def main() -> None:
    """Fuzz the readers in turn, each for its share of the time."""
    reading = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    reading.add_argument("--seconds", type=float, default=300.0, help="time in all")
    reading.add_argument(
        "--executions", type=int, default=10**9, help="most executions of a reader"
    )
    reading.add_argument(
        "--readers", nargs="*", default=[], help="beginnings of names; all without"
    )
    reading.add_argument("--seed", type=int, default=0)
    reading.add_argument("--findings", type=Path, default=Path("outputs/fuzz"))
    asked = reading.parse_args()
    logging.disable(logging.CRITICAL)
    # libpng and OpenCV write a line about every damaged image.
    global told
    told = os.dup(2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    warnings.simplefilter("ignore")
    chosen = [
        parser for name, parser in PARSERS.items()
        if not asked.readers or name.startswith(tuple(asked.readers))
    ]  # fmt: skip
    shares = sum(parser.share for parser in chosen)

    def saver(name: str) -> Callable[[bytes], Path]:
        def save(content: bytes) -> Path:
            asked.findings.mkdir(parents=True, exist_ok=True)
            path: Path = (
                asked.findings
                / f"{re.sub(r'[^a-z0-9]+', '-', name.lower())}-{abs(hash(content)):x}"
            )
            path.write_bytes(content)
            return path

        return save

    print(f"{'reader':<28}{'executions':>12}{'clear errors':>14}{'accepted':>12}{'findings':>10}")
    rows = []
    for parser in chosen:
        seconds = asked.seconds * parser.share / shares
        rows.append(fuzz(parser, seconds, asked.executions, asked.seed, saver(parser.name)))
        print(line(parser.name, rows[-1]), flush=True)
    whole = Row(
        *(sum(getattr(row, name) for row in rows) for name in ("executions", "refused", "accepted"))
    )
    whole.findings = [one for row in rows for one in row.findings]
    print(line("all", whole).partition("\n")[0])
    sys.exit(1 if whole.findings else 0)


if __name__ == "__main__":
    main()
