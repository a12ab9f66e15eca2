"""Methods that the measurement of depth compares, their coverage and failures, and the printed tables."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from depth.comparison import PREVIOUS, Scored, as_json, markdown, worst
from depth.coverage import Coverage, markdown_coverage
from depth.drawing import draw_worst
from depth.failures import depth_errors, flipped_fingers, markdown_failures
from depth.methods import TABLE_1, Method, run
from depth.sets import DepthSet
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.hand.model import HandModel
from measure_depth import main
from tests.support.second_camera import second
from tests.support.views import known_hands, views


@pytest.mark.parametrize(
    ("text", "name", "overrides"),
    [
        ("plain", "plain", ()),
        ("plain=", "plain", ()),
        ("a=prior=none,data_term=mse", "a", ("prior=none", "data_term=mse")),
        ("a=x=[1,2],y={b:1,c:2}", "a", ("x=[1,2]", "y={b:1,c:2}")),
    ],
)
def test_a_method_is_a_name_and_overrides(text: str, name: str, overrides: tuple[str, ...]) -> None:
    assert Method.parsed(text) == Method(name, overrides)


def test_a_method_without_a_name_is_refused() -> None:
    with pytest.raises(ValueError, match="'=prior=none' without a name"):
        Method.parsed("=prior=none")


def test_the_rows_are_those_of_the_experiments() -> None:
    for number, overrides in enumerate(TABLE_1.values(), start=1):
        config = Method("row", overrides).config("mediapipe")
        of_paper = Method("row", (f"experiment=ablation_row{number}",)).config("knuckle")
        for part in ("prior", "data_term", "hand"):
            assert config[part] == of_paper[part]


@pytest.fixture(scope="module")
def hands(hand: HandModel) -> DepthSet:
    batch = views(hand, known_hands(hand, 4))
    assert batch.intrinsics is not None
    assert batch.landmarks_3d is not None
    landmarks = ImageLandmarks(
        batch.landmarks_2d.double(), batch.labelled, torch.zeros(4, dtype=torch.bool),
        ("a_0", "a_1", "b_0", "b_1"), intrinsics=batch.intrinsics.double(),
    )  # fmt: skip
    truth = batch.landmarks_3d.double()
    return DepthSet("headset", landmarks, truth, ("a", "a", "b", "b"), second(truth))


@pytest.fixture(scope="module")
def scored(hands: DepthSet) -> list[Scored]:
    methods = [
        Method("free", ("prior=none", "lifter=none")),
        Method("ranges", ("prior=biomechanics", "lifter=none")),
        Method("one start", ("prior=biomechanics", "lifter=none", "descent.starts=1")),
    ]
    return [Scored.of(hands, run(method, hands, alone=1)) for method in methods]


def test_ranges_bring_exact_landmarks_nearer_to_the_ground_truth(scored: list[Scored]) -> None:
    assert scored[1].mean().value < scored[0].mean().value
    change = scored[1].change(scored[0])
    assert change.value == pytest.approx(scored[1].mean().value - scored[0].mean().value)
    assert all(one.run.batch_ms > 0 and one.run.alone_ms > 0 for one in scored)


def test_the_table_has_a_row_for_each_method_and_changes_against_one(scored: list[Scored]) -> None:
    lines = markdown(scored, "free").splitlines()
    assert len(lines) == 2 + 3
    assert lines[2].count("—") == 2
    assert f"{scored[2].change(scored[0]).value:+.2f} (" in lines[4]
    assert f"{scored[2].change(scored[1]).value:+.2f} (" in markdown(scored, PREVIOUS)
    assert len({line.count("|") for line in lines}) == 1


def test_the_json_has_every_hand(scored: list[Scored]) -> None:
    runs = json.loads(json.dumps(as_json(scored, PREVIOUS)))["runs"]
    assert [one["against"] for one in runs] == ["free", "free", "ranges"]
    assert runs[1]["pa_mpjpe_mm"][0] == pytest.approx(np.mean(list(runs[1]["errors_mm"].values())))
    assert runs[1]["pa_mpjpe_mm"][0] == pytest.approx(
        np.mean(list(runs[1]["landmarks_mm"].values()))
    )


def test_the_worst_hands_are_drawn_first(scored: list[Scored]) -> None:
    order = worst(scored[0], 3)
    errors = scored[0].errors[order]
    assert len(order) == 3
    assert (errors.diff() <= 0).all()
    assert errors[0] == scored[0].errors.max()
    drawn = draw_worst(scored[0], 3)
    assert drawn.shape[2] == 3
    # Coloured bones: pixels whose channels differ.
    assert (np.ptp(drawn.astype(int), axis=2) > 60).sum() > 500


@pytest.fixture
def gaussian(hands: DepthSet, scored: list[Scored]) -> Scored:
    """Errors drawn from covariances that differ by landmark, about one hand; the origin is exact."""
    count = 400
    first = torch.zeros(count, dtype=torch.long)
    sigma = 0.001 * torch.linspace(1, 4, 21, dtype=torch.float64)
    noise = sigma[:, None] * torch.randn(count, 21, 3, dtype=torch.float64)
    truth = hands.ground_truth[:1].expand(count, 21, 3)
    prediction = scored[0].run.parts[0].prediction.select(first)
    covariance = torch.diag_embed(sigma.square()[:, None].expand(21, 3)).expand(count, 21, 3, 3)
    part = replace(
        scored[0].run.parts[0],
        observed=hands.landmarks.select(first),
        prediction=replace(
            prediction,
            landmarks_3d=truth + noise,
            covariance_3d=covariance,
            parameters=replace(prediction.parameters, translation=truth[:, 9].float()),
        ),
        origins=(),
    )
    names = tuple(str(number) for number in range(count))
    many = replace(hands.select([0] * count), groups=names)
    return replace(scored[0], hands=many, run=replace(scored[0].run, parts=(part,)))


def resized(scored: Scored, scale: float) -> Scored:
    """The same fits of hands of another size and distance."""
    (part,) = scored.run.parts
    prediction = part.prediction
    assert prediction.covariance_3d is not None
    parameters = prediction.parameters
    part = replace(
        part,
        prediction=replace(
            prediction,
            landmarks_3d=scale * prediction.landmarks_3d,
            covariance_3d=scale**2 * prediction.covariance_3d,
            parameters=replace(parameters, translation=scale * parameters.translation),
        ),
    )
    return replace(scored, run=replace(scored.run, parts=(part,)))


def test_gaussian_errors_are_covered_as_a_gaussians_are(gaussian: Scored) -> None:
    found = Coverage.of(resized(gaussian, 2.0))
    assert found is not None
    # The translation takes a share of the errors of 21 landmarks.
    assert [share.value for share in found.within] == pytest.approx([50, 90, 95], abs=5)
    # Of |e| with e ~ N(0, σ²): the larger half of the σ has most of the larger errors.
    assert 0.5 < found.rank_correlation < 0.9


def test_positions_from_the_origin_are_neither_scaled_nor_centred(gaussian: Scored) -> None:
    found = Coverage.of(gaussian, aligned=False)
    assert found is not None
    # 8,000 errors: a standard error of half a percent of them.
    assert [share.value for share in found.within] == pytest.approx([50, 90, 95], abs=2.5)
    # A hand of another size has errors that an alignment hides: a tenth of several centimetres.
    larger = resized(gaussian, 1.1)
    from_origin, aligned = (Coverage.of(larger, aligned=value) for value in (False, True))
    assert from_origin is not None
    assert aligned is not None
    assert from_origin.within[1].value < 60 < 80 < aligned.within[1].value


def test_the_ground_truths_origin_is_no_error(gaussian: Scored) -> None:
    """The middle MCP is left out: with a covariance of nothing it changes no share."""
    (part,) = gaussian.run.parts
    covariance = part.prediction.covariance_3d
    assert covariance is not None
    without = covariance.clone()
    without[:, 9] = 1e-12 * torch.eye(3, dtype=torch.float64)
    other = replace(part, prediction=replace(part.prediction, covariance_3d=without))
    runs = [
        replace(gaussian, run=replace(gaussian.run, parts=(each,)))
        for each in (part, other)
    ]  # fmt: skip
    assert Coverage.of(runs[0], aligned=False) == Coverage.of(runs[1], aligned=False)
    assert Coverage.of(runs[0]) != Coverage.of(runs[1])


def test_the_table_of_coverage_has_both_quantities(gaussian: Scored) -> None:
    lines = markdown_coverage([gaussian]).splitlines()
    assert len(lines) == 3
    assert len({line.count("|") for line in lines}) == 1
    cells = [cell.strip() for cell in lines[2].split("|")[1:-1]]
    for place, aligned in ((2, True), (5, False)):
        coverage = Coverage.of(gaussian, aligned=aligned)
        assert coverage is not None
        for cell, share in zip(cells[place : place + 3], coverage.within, strict=True):
            assert cell.startswith(f"{share.value:.0f} (")


def test_a_fit_without_covariances_has_no_coverage(gaussian: Scored) -> None:
    (part,) = gaussian.run.parts
    none = replace(part, prediction=replace(part.prediction, covariance_3d=None))
    without = replace(gaussian, run=replace(gaussian.run, parts=(none,)))
    for aligned in (True, False):
        assert Coverage.of(without, aligned=aligned) is None
    assert not markdown_coverage([without])


def test_a_finger_is_flipped_where_its_tip_is_on_the_other_side_of_its_base() -> None:
    truth, errors = torch.zeros(4, 21, 3), torch.zeros(4, 21, 3)
    # The index, base 5 and tip 8: 30 mm behind its base, then 20 mm before it; and 10 mm behind; all exact.
    truth[:3, 8, 2] = 0.03
    errors[0, 8, 2] = -0.05
    errors[1, 8, 2] = -0.02
    # The same error with the base, and a tip that changes its side by 10 mm.
    errors[2, [5, 8], 2] = -0.05
    truth[3, 8, 2], errors[3, 8, 2] = 0.005, -0.01
    found = flipped_fingers(truth, errors)
    assert found.nonzero().tolist() == [[0, 1]]


def test_the_table_of_failures_has_all_hands_and_the_worst(scored: list[Scored]) -> None:
    lines = markdown_failures(scored[0]).splitlines()
    assert lines[2].startswith(f"| all | 4 | {scored[0].mean().value:.1f} |")
    assert lines[3].startswith(f"| worst tenth | 1 | {float(scored[0].errors.max()):.1f} |")
    assert len({line.count("|") for line in lines}) == 1
    errors = depth_errors(scored[0])
    torch.testing.assert_close(1000 * errors.norm(dim=-1), scored[0].landmark_errors)


def test_the_command_prints_a_table_and_writes_what_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--hands", "2", "--alone", "1", "--cache", str(tmp_path), "--method", "a=lifter=none"]
    main([*words, "--method", "b=lifter=none,data_term=mse", "--json", str(tmp_path / "all.json")])
    printed = capsys.readouterr().out
    assert printed.count("| synthetic (2) |") == 2
    assert printed.count("| synthetic, no camera (2) |") == 2
    assert len(json.loads((tmp_path / "all.json").read_text())["runs"]) == 4
    with pytest.raises(SystemExit, match="--against c is none of the methods"):
        main([*words, "--against", "c"])
