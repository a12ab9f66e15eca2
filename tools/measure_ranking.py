"""Measures whether labels of the images that `rank=uncertainty` lists first lower the error faster.

    python tools/measure_ranking.py --seeds 20

A simulation (`tools/error_bars/annotating.py`): 600 views of synthetic hands without labels, single ones or
frames of 150 clips; 20 random labels, then 20 more in each of 4 rounds, listed first or at random. The table
has the error on 300 other single hands, and the paired change with its 95 % interval over seeds.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from error_bars.annotating import Views, at_random, by_ranking, learning_curve
from hand_recon.tables.intervals import Bootstrap, interval

STEP = 20
ROUNDS = 4


def curves(
    pool: Views, held_out: Views, seed: int, *, step: int = STEP, rounds: int = ROUNDS
) -> Float[np.ndarray, "way=2 round"]:
    """Errors with the ranking, and with random images, from the same first labels.

    Args:
        pool: Images to label.
        held_out: Hands of the error.
        seed: Seed of the first labels and of the random images.
        step: Labels of each round.
        rounds: Rounds after the first labels.
    """
    return np.stack(
        [
            learning_curve(pool, held_out, choose, seed=seed, step=step, rounds=rounds)
            for choose in (by_ranking, at_random(1000 + seed))
        ]
    )


def main(words: Sequence[str] | None = None) -> None:
    """Run the simulation and print the table.

    Args:
        words: The command line; none for this process's own.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", type=int, default=20, help="repetitions")
    parser.add_argument("--hands", type=int, default=600, help="views; half as many are held out")
    parser.add_argument("--cache", type=Path, default=Path("outputs/cache"), help="folder of views")
    arguments = parser.parse_args(words)
    single = Views.of("train", arguments.hands, arguments.cache)
    held_out = Views.of("val", arguments.hands // 2, arguments.cache)
    print("| images | labels | listed first, mm | at random, mm | change, mm (95 %) |")
    print("| --- | --- | --- | --- | --- |")
    for name in ("frames of clips", "single images"):
        pools = [
            single.as_clips(arguments.hands // 4, arguments.hands, seed)
            if name == "frames of clips"
            else single
            for seed in range(arguments.seeds)
        ]
        both = np.stack([curves(pool, held_out, seed) for seed, pool in enumerate(pools)])
        for step, (first, random) in enumerate(both.transpose(2, 1, 0)):
            found = interval(Bootstrap().means((first - random)[:, None])[:, 0])
            change = f"{(first - random).mean():+.2f} ({found.low:+.2f} … {found.high:+.2f})"
            print(
                f"| {name} | {STEP * (step + 1)} | {first.mean():.2f} | {random.mean():.2f} | {change} |"
            )


if __name__ == "__main__":
    main()
