"""The range tables are complete, cited and plausible, and a user's own table is checked."""

import math
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from hand_recon.hand.anatomical_frame import angles_to_rotation, rotation_to_angles
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges, table_path
from tests.support.tolerance import assert_close

BEND, SPLAY, TWIST = (AXES.index(axis) for axis in ("bend", "splay", "twist"))


def _degrees(ranges: RangeOfMotion, joint: str, axis: str) -> tuple[float, float]:
    index = ARTICULATED.index(joint), AXES.index(axis)
    return round(math.degrees(ranges.lower[index]), 3), round(math.degrees(ranges.upper[index]), 3)


def _table(name: str) -> dict[str, Any]:
    table: Any = OmegaConf.to_container(OmegaConf.load(table_path(name)))
    return dict(table)


def _edited(tmp_path: Path, joint: str, axis: str, row: list[object]) -> str:
    table = _table("literature")
    table["joints"][joint][axis] = row
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    return str(tmp_path / "mine.yaml")


@pytest.mark.parametrize("name", ["literature", "paper_release"])
def test_every_joint_has_a_range_on_every_axis(name: str) -> None:
    ranges = load_ranges(name, torch.zeros(15, 3))
    assert ranges.lower.shape == ranges.upper.shape == (15, 3)
    assert bool((ranges.lower <= ranges.upper).all())


def test_the_literature_is_read_as_printed_in_radians() -> None:
    ranges = load_ranges("literature")
    assert _degrees(ranges, "index MCP", "bend") == (-25.9, 84.7)
    assert _degrees(ranges, "little MCP", "splay") == (-54.6, 15.1)
    assert _degrees(ranges, "thumb IP", "bend") == (-15, 80)


def test_the_release_counts_from_manos_spread_template() -> None:
    """Index splay is published as −40 to 5 about a finger that MANO spreads by 3.9."""
    ranges = load_ranges("paper_release")
    assert _degrees(ranges, "index MCP", "splay") == (-36.1, 8.9)
    assert _degrees(ranges, "little MCP", "splay") == (-46.3, 8.7)
    assert _degrees(ranges, "ring MCP", "bend") == (-20, 90)
    assert _degrees(ranges, "thumb CMC", "bend") == (-20, 90)


def test_the_neutral_hand_is_inside_both_tables(hand: HandModel) -> None:
    for name in ("literature", "paper_release"):
        assert bool(load_ranges(name, hand.rest_angles).contains(hand.neutral_angles())), name


def test_a_table_without_a_template_of_its_own_moves_with_the_rest_pose(tmp_path: Path) -> None:
    table = _table("literature") | {"reference": "template"}
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    rest = torch.linspace(-0.4, 0.4, 45).view(15, 3)
    moved, still = load_ranges(str(tmp_path / "mine.yaml"), rest), load_ranges("literature", rest)
    torch.testing.assert_close(moved.lower, still.lower + rest)
    torch.testing.assert_close(moved.upper, still.upper + rest)


@pytest.mark.parametrize("name", ["literature", "paper_release"])
def test_no_joint_twists_and_hinges_do_not_splay(name: str) -> None:
    ranges = load_ranges(name, torch.zeros(15, 3))
    assert not ranges.lower[:, TWIST].any()
    assert not ranges.upper[:, TWIST].any()
    hinges = [i for i, joint in enumerate(ARTICULATED) if joint.split()[1] in ("PIP", "DIP", "IP")]
    assert not ranges.upper[hinges, SPLAY].any()


def test_the_released_table_has_the_twenty_freedoms_of_the_paper() -> None:
    ranges = load_ranges("paper_release", torch.zeros(15, 3))
    assert int((ranges.upper > ranges.lower).sum()) == 20


def test_every_joint_flexes_farther_than_it_extends() -> None:
    ranges = load_ranges("literature")
    assert bool((ranges.upper[:, BEND] > -ranges.lower[:, BEND]).all())


@pytest.mark.parametrize("name", ["literature", "paper_release"])
def test_every_bound_names_a_source_and_every_source_is_used(name: str) -> None:
    table = _table(name)
    rows = [table["joints"][joint][axis] for joint in ARTICULATED for axis in AXES]
    assert {len(row) for row in rows} <= {3, 4}
    assert {str(source) for row in rows for source in row[2:]} == set(table["sources"])
    assert all(len(text) > 20 for text in table["sources"].values())


def test_the_means_of_latz_are_at_the_fingers_they_were_measured_on() -> None:
    """The abstract's eight numbers a bound: flexion, extension, radial, ulnar deviation."""
    measured = {
        "index": (84.7, 25.9, 32.1, 22.6),
        "middle": (84.8, 25.9, 28.8, 22.1),
        "ring": (87.2, 22.8, 8.1, 32.3),
        "little": (84.0, 32.1, 15.1, 54.6),
    }
    ranges = load_ranges("literature")
    for finger, (flexion, extension, radial, ulnar) in measured.items():
        assert _degrees(ranges, f"{finger} MCP", "bend") == (-extension, flexion)
        assert _degrees(ranges, f"{finger} MCP", "splay") == (-ulnar, radial)


def test_the_thumbs_metacarpal_has_the_totals_of_cooney() -> None:
    ranges = load_ranges("literature")
    for axis, total in (("bend", 53), ("splay", 42)):
        lower, upper = _degrees(ranges, "thumb CMC", axis)
        assert upper - lower == pytest.approx(total)


@pytest.mark.parametrize("name", ["literature", "paper_release"])
def test_ranges_are_those_of_a_hand(name: str) -> None:
    """Fingers bend by 80 to 110 degrees, no joint goes beyond 110, and every range holds the neutral."""
    ranges = load_ranges(name, torch.zeros(15, 3))
    degrees = torch.stack([ranges.lower, ranges.upper]).rad2deg().round(decimals=3)
    fingers = [i for i, joint in enumerate(ARTICULATED) if not joint.startswith("thumb")]
    assert bool(((degrees[1, fingers, BEND] >= 80) & (degrees[1, fingers, BEND] <= 110)).all())
    assert bool((degrees.abs() <= 110).all())
    assert bool((degrees[0] <= 0).all() and (degrees[1] >= 0).all())


def test_clamping_brings_every_pose_inside_and_leaves_the_inside_alone() -> None:
    ranges = load_ranges("literature")
    wild = 3 * torch.randn(20, 15, 3, generator=torch.Generator().manual_seed(0))
    clamped = ranges.clamp(wild)
    assert bool(ranges.contains(clamped).all())
    torch.testing.assert_close(ranges.clamp(clamped), clamped)


def test_a_users_own_table_is_read_from_its_path(tmp_path: Path) -> None:
    path = _edited(tmp_path, "index PIP", "bend", [-5, 90, "textbook"])
    assert _degrees(load_ranges(path), "index PIP", "bend") == (-5, 90)


def test_an_unknown_table_is_refused_with_the_names_of_the_known_ones() -> None:
    with pytest.raises(FileNotFoundError, match=r"literature.*paper_release"):
        load_ranges("literatur")


def test_a_table_that_counts_from_the_template_needs_the_rest_pose(tmp_path: Path) -> None:
    table = _table("literature") | {"reference": "template"}
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match="rest_angles"):
        load_ranges(str(tmp_path / "mine.yaml"))


def test_a_bound_may_have_a_source_of_its_own(tmp_path: Path) -> None:
    path = _edited(tmp_path, "index PIP", "bend", [-5, 90, "latz", "textbook"])
    assert _degrees(load_ranges(path), "index PIP", "bend") == (-5, 90)


def test_a_reflection_negates_bend_and_splay_and_keeps_twist() -> None:
    """A left hand's own rotations (MANO_LEFT) would need other ranges, so left hands are mirrored."""
    angles = torch.randn(200, 15, 3, dtype=torch.float64)
    # Both hands' x axes point to the wrist: a reflection in x alone takes one hand's frames to the other's.
    reflection = torch.diag(torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    folded = angles.clamp(-1.5, 1.5)  # Where the Euler angles of a rotation are unique.
    left = rotation_to_angles(reflection @ angles_to_rotation(folded) @ reflection)
    assert_close(left, folded * torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ([10, -10, "latz"], "minimum must not exceed"),
        ([0, 400, "latz"], "within ±180"),
        ([0, 10], "minimum, maximum, source"),
        ([0, 10, "hearsay"], "hearsay"),
        ([0, 10, "latz", "hearsay"], "hearsay"),
        ([0, 10, "latz", "latz", "latz"], "source of the minimum, source of the maximum"),
    ],
)
def test_a_bad_row_is_refused(tmp_path: Path, row: list[object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        load_ranges(_edited(tmp_path, "ring MCP", "bend", row))


def test_a_missing_joint_and_an_unknown_one_are_both_named(tmp_path: Path) -> None:
    table = _table("literature")
    table["joints"]["pinky MCP"] = table["joints"].pop("little MCP")
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match=r"missing \['little MCP'\].*unknown \['pinky MCP'\]"):
        load_ranges(str(tmp_path / "mine.yaml"))


def test_an_unknown_axis_is_refused(tmp_path: Path) -> None:
    table = _table("literature")
    table["joints"]["ring MCP"]["roll"] = table["joints"]["ring MCP"].pop("twist")
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match="roll"):
        load_ranges(str(tmp_path / "mine.yaml"))


def test_a_table_must_say_what_it_counts_from(tmp_path: Path) -> None:
    table = _table("literature")
    table["reference"] = "somewhere"
    OmegaConf.save(OmegaConf.create(table), tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match="somewhere"):
        load_ranges(str(tmp_path / "mine.yaml"))


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("just: this\n")
    with pytest.raises(ValueError, match="joints"):
        load_ranges(str(tmp_path / "mine.yaml"))
