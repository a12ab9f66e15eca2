"""Measure the whole path from photographs to hands: what is found, how well it fits, and how long it takes.

    python -m tools.measure_predict <folder> --labels test.json [--count 200] [--threads 1]

The labels are `[{"image": …, "landmarks": [[u, v], …], "side": …}, …]`, images relative to the folder. Errors
are in pixels of an image whose longer side has 256. A detected hand belongs to the label that it overlaps;
images with several hands count for the hand that is labelled.
"""

import argparse
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from hand_recon.command_line.composing import composed
from hand_recon.command_line.processor import share_processor
from hand_recon.data.photos.photo import read_photo
from hand_recon.evaluation.plausibility import Plausibility
from hand_recon.fitting.drawing import drawn_hand
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.in_parts import PART, fit_part
from hand_recon.fitting.photo_camera import parse_camera
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.fit_run import adapted_to_data, source_of
from hand_recon.runs.fitters import build_fitter
from hand_recon.runs.looking import LookedAt, build_detector, look_at_file, to_landmarks
from hand_recon.visualization.hand_overlay import draw_hands

REFERENCE: Final = 256
"""Longer side of the image in whose pixels errors are given."""


class Report:
    """Errors, verdicts and times of the hands so far."""

    def __init__(self, hand: Any) -> None:  # noqa: ANN401  # a HandModel
        self.hand = hand
        self.plausibility = Plausibility(load_ranges("literature"), NonPenetration(hand))
        self.errors: dict[str, list[float]] = {"detected": [], "fitted": [], "residual": []}
        self.verdicts: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.seconds: dict[str, list[float]] = {}
        self.hands = self.other_side = self.unmatched = 0

    def add(self, looked: list[LookedAt], part: FittedHands, labels: dict[str, Any]) -> None:
        """Add fitted hands of some images."""
        start = time.perf_counter()
        records = to_records(part)
        self.seconds.setdefault("verdict", []).append((time.perf_counter() - start) / len(part))
        self.verdicts.update(records.verdicts)
        for reasons in records.reasons:
            self.reasons.update(" ".join(one.split()[:6]) for one in reasons)
        kept = part.fitted
        self.plausibility.update(
            part.prediction.parameters.joint_angles[kept],
            part.prediction.vertices[kept],
            torch.arange(self.hands, self.hands + int(kept.sum())),
        )
        first = 0
        for one in looked:
            rows = list(range(first, first + len(one.hands)))
            first += len(one.hands)
            self._compare(one, rows, part, records, labels)
        self.hands += len(part)

    def _compare(
        self,
        one: LookedAt,
        rows: list[int],
        part: FittedHands,
        records: HandRecords,
        labels: dict[str, Any],
    ) -> None:
        label = labels[one.name]
        given = np.array(label["landmarks"], dtype=float)
        unit = REFERENCE / max(one.size or (1, 1))
        distances = [
            float(np.linalg.norm(records.observed_2d[row] - given, axis=1).mean()) for row in rows
        ]
        if not rows or min(distances) * unit > 40:
            self.unmatched += 1
            return
        row = rows[int(np.argmin(distances))]
        self.other_side += records.sides[row] != label["side"]
        self.errors["detected"].append(min(distances) * unit)
        fitted = np.linalg.norm(records.landmarks_2d[row] - given, axis=1).mean()
        self.errors["fitted"].append(float(fitted) * unit)
        self.errors["residual"].append(float(records.residual[row]) * unit)

    def draw(self, looked: list[LookedAt], part: FittedHands) -> None:
        """Time the drawing of some images."""
        records, first = to_records(part), 0
        vertices = part.prediction.vertices.numpy()
        for one in looked:
            rows = range(first, first + len(one.hands))
            first += len(one.hands)
            start = time.perf_counter()
            if one.path is not None and len(rows):
                hands = [drawn_hand(records, vertices, row, str(row)) for row in rows]
                draw_hands(read_photo(one.path).pixels, hands, self.hand.faces.numpy())
                self.seconds.setdefault("draw", []).append(time.perf_counter() - start)


def measure(options: argparse.Namespace) -> Report:
    """Run the path over the images."""
    rows = json.loads((options.folder / options.labels).read_text(encoding="utf-8"))
    rows = rows[:: max(1, len(rows) // options.count)] if options.count else rows
    labels = {row["image"]: row for row in rows}
    overrides = ["input=[]", f"detector.threads={options.threads}", *options.overrides]
    config = adapted_to_data(composed("predict", overrides))
    hand = build_hand(config)
    detector, fitter = build_detector(config), build_fitter(config, hand)
    camera, report = parse_camera("auto", len(labels)), Report(hand)
    origin = source_of(config, hand, detector.name)
    batch: list[LookedAt] = []
    for number, name in enumerate(labels):
        found = look_at_file(number, name, options.folder / name, detector, camera)
        for stage, seconds in found.seconds.items():
            report.seconds.setdefault(stage, []).append(seconds)
        batch.append(found)
        if sum(len(one.hands) for one in batch) >= PART or number == len(labels) - 1:
            landmarks, origins = to_landmarks(batch, origin)
            start = time.perf_counter()
            part = fit_part(landmarks, fitter, origins)
            each = (time.perf_counter() - start) / len(part)
            report.seconds.setdefault("fit of a hand", []).append(each)
            report.add(batch, part, labels)
            if options.draw:
                report.draw(batch, part)
            batch = []
    return report


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--labels", default="test.json")
    parser.add_argument("--count", type=int, default=0, help="about so many images, spread evenly")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--draw", action="store_true", help="time the drawings, too")
    parser.add_argument("overrides", nargs="*", help="settings of hand-recon predict")
    options = parser.parse_intermixed_args()
    share_processor()
    torch.set_num_threads(options.threads)
    report = measure(options)
    images = len(report.seconds["detect"])
    print(
        f"{images} images, {report.hands} hands; {report.unmatched} labelled hands not found, "
        f"{report.other_side} on the other side"
    )
    for name, values in report.errors.items():
        print(
            f"{name}: mean {np.mean(values):.2f}, median {np.median(values):.2f}, "
            f"95 % {np.percentile(values, 95):.2f} px of {REFERENCE}"
        )
    print(dict(report.verdicts), report.plausibility.compute())
    for reason, count in report.reasons.most_common(12):
        print(f"  {count}: {reason} …")
    for stage, times in report.seconds.items():
        print(
            f"{stage}: median {1e3 * np.median(times):.1f} ms, mean {1e3 * np.mean(times):.1f} ms"
        )


if __name__ == "__main__":
    main()
