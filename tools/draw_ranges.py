"""Figures and tables of `docs/ranges.md`: `python tools/draw_ranges.py`.

Draws both tables of ranges with natural poses over them, and the ranges as Eq. 2–3 narrow them; prints the
violations of natural and unnatural poses as the page's Markdown tables.
"""

import argparse
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import torch
from jaxtyping import Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from torch import Tensor

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.data.synthetic.unnatural import KINDS, sample_unnatural_pose
from hand_recon.evaluation.plausibility import ROM_TOLERANCE, range_violation
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.functional_anatomy import VARIANTS, FunctionalAnatomy
from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
TABLES = ("literature", "paper_release")
COLOURS = {"literature": "#3b73b9", "paper_release": "#d98032"}
STYLES = {"paper": ("#3b73b9", "-"), "printed": ("#5a9e6f", ":"), "release": ("#d98032", "--")}
BEND, SPLAY = AXES.index("bend"), AXES.index("splay")
RANGE_OF_MOTION_WEIGHT = 20_000.0  # λ₁ of Sec. 4.1, against squared pixels.

NONE = FunctionalAnatomy(
    splay_by_bend=False, bend_by_splay=False, pip_by_dip=False, thumb_cmc=False
)
RULES = {
    "ranges alone": NONE,
    "splay by bend": replace(NONE, splay_by_bend=True),
    "bend by splay": replace(NONE, bend_by_splay=True),
    "PIP by DIP": replace(NONE, pip_by_dip=True),
    "thumb CMC": replace(NONE, thumb_cmc=True),
    "all but bend by splay": FunctionalAnatomy(bend_by_splay=False),
    "all": FunctionalAnatomy(bend_by_splay=True),
}
MEAN_DEVIATION = 11.2
"""Mean of Latz et al.'s standard deviations, degrees; used for joints that are not in `DEVIATIONS`."""
DEVIATIONS = {
    "index MCP": ((10.2, 8.6), (12.8, 11.3)),
    "middle MCP": ((10.1, 8.5), (8.9, 11.1)),
    "ring MCP": ((11.6, 11.5), (12.4, 5.8)),
    "little MCP": ((16.8, 8.6), (18.7, 12.9)),
}
"""Standard deviations of extension, flexion, ulnar and radial deviation, degrees."""


def natural_poses(count: int) -> Float[Tensor, "pose joint=15 axis=3"]:
    """Sample natural poses: `count` of each split's gestures."""
    random = np.random.default_rng(0)
    poses = [sample_pose(random, held_out=held) for held in (False, True) for _ in range(count)]
    return torch.from_numpy(np.stack(poses)).float()


def unnatural_poses(kind: str, count: int) -> Float[Tensor, "pose joint=15 axis=3"]:
    """Sample natural poses with one finger made unnatural, in the way that `kind` names."""
    random = np.random.default_rng(1)
    poses = [sample_unnatural_pose(random, kind).joint_angles for _ in range(count)]
    return torch.from_numpy(np.stack(poses)).float()


def draw_tables(poses: Tensor, path: Path) -> None:
    """Draw the range of each free axis in both tables as bars, and the natural poses' angles over them."""
    tables = {name: load_ranges(name) for name in TABLES}
    order = sorted(range(15), key=lambda joint: "thumb index middle ring little".find(
        ARTICULATED[joint].split()[0]
    ))  # fmt: skip
    free = [
        (joint, axis) for joint in order for axis in (BEND, SPLAY)
        if any(bool(table.upper[joint, axis] > table.lower[joint, axis]) for table in tables.values())
    ]  # fmt: skip
    figure = plt.figure(figsize=(8.2, 8.6))
    panel = figure.add_subplot()
    for row, (joint, axis) in enumerate(free):
        for offset, (name, table) in zip((-0.19, 0.19), tables.items(), strict=True):
            lower, upper = (float(end[joint, axis].rad2deg()) for end in (table.lower, table.upper))
            slack = float(np.degrees(ROM_TOLERANCE))
            panel.barh(
                row + offset, upper - lower + 2 * slack, 0.34, lower - slack,
                color=COLOURS[name], alpha=0.18,
            )  # fmt: skip
            panel.barh(
                row + offset, upper - lower, 0.34, lower, color=COLOURS[name],
                label=name if row == 0 else None,
            )  # fmt: skip
        angles = poses[:, joint, axis].rad2deg().numpy()
        low, first, middle, last, high = np.percentile(angles, [0, 1, 50, 99, 100])
        panel.plot([low, high], [row, row], color="black", linewidth=0.8)
        panel.plot([first, last], [row, row], color="black", linewidth=2.6)
        panel.plot(middle, row, "o", color="white", markeredgecolor="black", markersize=4)
    panel.plot([], [], color="black", linewidth=2.6, label="natural poses: 1–99 %, all, median")
    panel.bar(0, 0, color="grey", alpha=0.25, label="tolerance of the score, 22.5°")
    labels = [f"{ARTICULATED[joint]} {AXES[axis]}" for joint, axis in free]
    panel.set_yticks(range(len(free)), labels, fontsize=8)
    panel.set_ylim(len(free) - 0.4, -0.6)
    panel.set_xlim(-80, 135)
    panel.axvline(0, color="grey", linewidth=0.6)
    panel.set_xlabel("degrees from the anatomical neutral")
    panel.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False)
    _save(figure, path)


def draw_couplings(poses: Tensor, path: Path) -> None:
    """Draw, for three joints, the range of splay by bend in every variant, and natural poses."""
    literature = load_ranges("literature")
    figure, panels = plt.subplots(1, 3, figsize=(10, 3.4))
    for panel, name in zip(panels, ("index MCP", "ring MCP", "thumb CMC"), strict=True):
        joint = ARTICULATED.index(name)
        panel.plot(*poses[::2, joint, [BEND, SPLAY]].rad2deg().T, ".", color="0.75", markersize=1.5)
        _draw_variants(panel, literature, joint)
        panel.set_title(name, fontsize=9)
        panel.set_xlabel("bend, degrees", fontsize=8)
        panel.tick_params(labelsize=7)
    panels[0].set_ylabel("range of splay, degrees", fontsize=8)
    panels[0].legend(fontsize=7, loc="upper right")
    _save(figure, path)


def _draw_variants(panel: Axes, ranges: RangeOfMotion, joint: int) -> None:
    angles = torch.zeros(200, 15, 3)
    lower, upper = ranges.lower[joint, BEND], ranges.upper[joint, BEND]
    angles[:, joint, BEND] = torch.linspace(float(lower), float(upper), 200)
    for variant in VARIANTS:
        refined = FunctionalAnatomy(variant=variant).refine(ranges, angles)
        colour, style = STYLES[variant]
        for end, label in ((refined.lower, None), (refined.upper, variant)):
            bend, splay = angles[:, joint, BEND].rad2deg(), end[:, joint, SPLAY].rad2deg()
            panel.plot(bend, splay, style, color=colour, linewidth=1.4, label=label)


def print_rules(poses: Tensor) -> None:
    """Print violations of natural poses, rule by rule."""
    _print_row("table", "variant", "rules", "mean", "99 %", "largest", "> 22.5°", "λ₁ L_pose")
    _print_row(*["---"] * 8)
    for name in TABLES:
        for variant in VARIANTS:
            for label, rules in RULES.items():
                ranges = replace(rules, variant=variant).refine(load_ranges(name), poses)
                loss = RANGE_OF_MOTION_WEIGHT * range_of_motion_loss(poses, ranges).mean()
                _print_row(name, variant, label, *_summary(poses, ranges), f"{loss:.0f}")


def print_alternatives(poses: Tensor) -> None:
    """Print violations with wider ranges: means plus one or two standard deviations."""
    _print_row("literature", "mean", "99 %", "largest", "> 22.5°")
    _print_row(*["---"] * 5)
    for name, factor in (("means", 0), ("means + 1 SD", 1), ("means + 2 SD", 2)):
        _print_row(name, *_summary(poses, _widened(load_ranges("literature"), factor)))


def print_tolerances(poses: Tensor) -> None:
    """Print the percentages of hands that the score counts as unnatural, by tolerance."""
    unnatural = {kind: unnatural_poses(kind, 1000) for kind in KINDS}
    _print_row("table", "tolerance", "natural", *(kind.replace("_", "-") for kind in KINDS))
    _print_row(*["---"] * (3 + len(KINDS)))
    for name in TABLES:
        for tolerance in (5, 10, 15, 20, 22.5, 25, 30):
            ranges = load_ranges(name)
            shares = [_share_beyond(a, ranges, tolerance) for a in (poses, *unnatural.values())]
            _print_row(name, f"{tolerance}°", *(f"{share:.1f} %" for share in shares))


def _widened(ranges: RangeOfMotion, factor: float) -> RangeOfMotion:
    """Widen every free bound by a number of standard deviations."""
    deviations = torch.full((2, 15, 3), MEAN_DEVIATION)
    for joint, rows in DEVIATIONS.items():
        deviations[:, ARTICULATED.index(joint), :2] = torch.tensor(rows).T
    more = factor * deviations.deg2rad() * (ranges.upper > ranges.lower)
    return RangeOfMotion(ranges.lower - more[0], ranges.upper + more[1])


def _share_beyond(poses: Tensor, ranges: RangeOfMotion, degrees: float) -> float:
    """Percentage of hands with a joint outside its range by more than these degrees."""
    return 100 * float((range_violation(poses, ranges).rad2deg() > degrees).double().mean())


def _summary(poses: Tensor, ranges: RangeOfMotion) -> list[str]:
    violation = range_violation(poses, ranges).rad2deg()
    beyond = _share_beyond(poses, ranges, float(np.degrees(ROM_TOLERANCE)))
    numbers = (violation.mean(), violation.quantile(0.99), violation.max())
    return [*(f"{number:.1f}°" for number in numbers), f"{beyond:.1f} %"]


def _print_row(*cells: str) -> None:
    print(f"| {' | '.join(cells)} |")


def _save(figure: Figure, path: Path) -> None:
    figure.tight_layout(pad=0.5)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100)
    plt.close(figure)
    # Few colours keep the files small enough for the repository.
    Image.open(buffer).convert("RGB").quantize(64).save(path, optimize=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the figures and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder for the images")
    parser.add_argument("--poses", type=int, default=2000, help="natural poses of each split")
    parsed = parser.parse_args(arguments)
    parsed.out.mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    torch.set_num_threads(1)
    poses = natural_poses(parsed.poses)
    draw_tables(poses, parsed.out / "ranges.png")
    draw_couplings(poses, parsed.out / "couplings.png")
    for section in (print_rules, print_tolerances, print_alternatives):
        section(poses)
        print()


if __name__ == "__main__":
    main()
