"""Metrics over a dataset: correct values, each sample counted once, missing ground truth reported."""

import pickle
import socket

import pytest
import torch
from torch import Tensor
from torch.multiprocessing.spawn import start_processes

from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.scores import HandPoints
from hand_recon.speed.published import scores_by_definition
from tests.support import metric_reference as reference

VERTICES = 60
"""Number of vertices: fewer than a hand's, to save time."""


def hands(count: int, *, seed: int = 0, noise: float = 0.0, surface: bool = True) -> HandPoints:
    """Random points of a hand's size, 60 cm away; the same points for every amount of noise."""
    generator = torch.Generator().manual_seed(seed)
    size = torch.tensor([0.08, 0.03, 0.02])
    points = torch.randn(count, 21 + VERTICES, 3, generator=generator) * size
    points = points + torch.tensor([0.0, 0.0, 0.6])
    points = points + noise * torch.randn(points.shape, generator=generator)
    return HandPoints(points[:, :21], points[:, 21:] if surface else None)


def measure(
    prediction: HandPoints, ground_truth: HandPoints, index: Tensor | None = None
) -> HandMetrics:
    metrics = HandMetrics()
    metrics.update(
        prediction, ground_truth, torch.arange(len(ground_truth)) if index is None else index
    )
    return metrics


def stacked(*parts: HandPoints) -> HandPoints:
    vertices = [part.vertices for part in parts if part.vertices is not None]
    return HandPoints(
        torch.cat([part.landmarks for part in parts]), torch.cat(vertices) if vertices else None
    )


def approx(expected: dict[str, float]) -> object:
    return pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_every_score_agrees_with_the_reference() -> None:
    ground_truth, prediction = hands(6), hands(6, noise=0.008)
    actual = measure(prediction, ground_truth).compute()
    assert ground_truth.vertices is not None
    assert prediction.vertices is not None
    pairs = {
        "J": (ground_truth.landmarks.double().numpy(), prediction.landmarks.double().numpy()),
        "V": (ground_truth.vertices.double().numpy(), prediction.vertices.double().numpy()),
    }
    expected: dict[str, float] = {}
    wrists = (pairs["J"][0][:, :1], pairs["J"][1][:, :1])
    for kind, (points, predicted) in pairs.items():
        both = list(zip(points, predicted, strict=True))
        aligned = {
            "": [scores_by_definition.align_official(*pair) for pair in both],
            "_proper": [reference.align_proper(*pair) for pair in both],
            "_unaligned": list(predicted),
        }
        for suffix, moved in aligned.items():
            error, area = reference.point_scores(list(points), moved)
            expected |= {f"E_{kind}{suffix}": 1000 * error, f"AUC_{kind}{suffix}": area}
            if kind == "V":
                for threshold in (5, 15):
                    scores = [
                        reference.f_score(t, p, threshold / 1000)
                        for t, p in zip(points, moved, strict=True)
                    ]
                    expected[f"F@{threshold}{suffix}"] = sum(scores) / len(scores)
        error, _ = reference.point_scores(list(points - wrists[0]), list(predicted - wrists[1]))
        expected["MPJPE" if kind == "J" else "E_RV"] = 1000 * error
    assert actual == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_a_translation_by_ten_millimetres_is_an_error_only_without_alignment() -> None:
    ground_truth = hands(3)
    assert ground_truth.vertices is not None
    shift = torch.tensor([0.01, 0.0, 0.0])
    scores = measure(
        HandPoints(ground_truth.landmarks + shift, ground_truth.vertices + shift), ground_truth
    ).compute()
    assert scores["E_J_unaligned"] == pytest.approx(10, abs=1e-3)
    assert scores["AUC_J_unaligned"] == pytest.approx(0.80303, abs=1e-5)
    for name in ("E_J", "E_J_proper", "MPJPE", "E_V", "E_RV"):
        assert scores[name] == pytest.approx(0, abs=1e-3)


def test_a_mirrored_hand_has_an_error_without_reflections() -> None:
    ground_truth = hands(4)
    assert ground_truth.vertices is not None
    mirror = torch.tensor([-1.0, 1.0, 1.0])
    scores = measure(
        HandPoints(ground_truth.landmarks * mirror, ground_truth.vertices * mirror), ground_truth
    ).compute()
    assert scores["E_J"] < 1e-3
    assert scores["F@5"] == 1
    assert scores["E_J_proper"] > 5
    assert scores["E_V_proper"] > 5
    assert scores["F@5_proper"] < 0.9


def test_perfect_predictions_are_perfect_in_every_metric() -> None:
    scores = measure(hands(3), hands(3)).compute()
    for name, value in scores.items():
        perfect = 0 if name.startswith(("E_", "MPJPE")) else 1
        assert value == pytest.approx(perfect, abs=98.5 / 99 - 0.98)


def test_the_order_and_the_batching_of_samples_do_not_matter() -> None:
    ground_truth, prediction = hands(7), hands(7, noise=0.01)
    expected = measure(prediction, ground_truth).compute()
    metrics = HandMetrics()
    for part in torch.randperm(7).split(3):
        metrics.update(prediction[part], ground_truth[part], part)
    assert metrics.compute() == approx(expected)


def test_a_sample_that_comes_twice_counts_once() -> None:
    ground_truth, prediction = hands(5), hands(5, noise=0.01)
    padded = torch.tensor([0, 1, 2, 3, 4, 0, 1, 1])
    metrics = measure(prediction[padded], ground_truth[padded], padded + 100)
    assert metrics.compute() == approx(measure(prediction, ground_truth).compute())


def test_two_processes_merge_to_what_one_computes() -> None:
    ground_truth, prediction = hands(5), hands(5, noise=0.01)
    first, second = torch.tensor([0, 2, 4]), torch.tensor([1, 3, 0])
    merged = measure(prediction[first], ground_truth[first], first)
    other = measure(prediction[second], ground_truth[second], second)
    merged._reduce_states(other.metric_state)
    assert merged.compute() == approx(measure(prediction, ground_truth).compute())


def test_different_samples_under_one_index_are_refused() -> None:
    ground_truth, prediction = hands(2), hands(2, noise=0.01)
    metrics = measure(prediction, ground_truth, torch.tensor([7, 7]))
    with pytest.raises(ValueError, match=r"samples 7 came twice .* one metric per dataset"):
        metrics.compute()


def test_vertex_metrics_are_absent_without_ground_truth_vertices() -> None:
    scores = measure(hands(3, noise=0.01), hands(3, surface=False)).compute()
    assert not [name for name in scores if "V" in name or "F@" in name]
    with_surface = measure(hands(3, noise=0.01), hands(3)).compute()
    assert scores == {name: with_surface[name] for name in scores}


def test_a_mixture_with_and_without_surfaces_is_refused() -> None:
    metrics = measure(hands(3, noise=0.01), hands(3))
    metrics.update(hands(2), hands(2, surface=False), torch.tensor([3, 4]))
    with pytest.raises(ValueError, match=r"only 3 of them .* vertices"):
        metrics.compute()


def test_samples_without_ground_truth_are_left_out_and_counted() -> None:
    ground_truth, prediction = hands(5), hands(5, noise=0.01)
    expected = measure(prediction[:3], ground_truth[:3]).compute()
    assert ground_truth.vertices is not None
    ground_truth.landmarks[3] = float("nan")
    ground_truth.vertices[3:] = float("nan")
    ground_truth.landmarks[4, 20, 2] = float("nan")
    metrics = measure(prediction, ground_truth)
    with pytest.warns(UserWarning, match="2 of 5 samples have no ground truth"):
        assert metrics.compute() == approx(expected)


def test_without_any_ground_truth_there_are_no_scores() -> None:
    ground_truth = HandPoints(torch.full((2, 21, 3), float("nan")))
    with pytest.warns(UserWarning, match="2 of 2 samples"):
        assert measure(hands(2), ground_truth).compute() == {}


def test_predictions_that_are_not_finite_name_their_samples() -> None:
    prediction = hands(3)
    prediction.landmarks[1, 4] = float("nan")
    with pytest.raises(ValueError, match="landmarks of the samples 11 are not finite"):
        measure(prediction, hands(3), torch.tensor([10, 11, 12]))
    prediction = hands(3)
    assert prediction.vertices is not None
    prediction.vertices[2, 0, 0] = float("inf")
    with pytest.raises(ValueError, match="vertices of the samples 12 are not finite"):
        measure(prediction, hands(3), torch.tensor([10, 11, 12]))


def test_another_number_of_vertices_is_refused_with_a_remedy() -> None:
    ground_truth, prediction = hands(2), hands(2)
    assert prediction.vertices is not None
    other = HandPoints(prediction.landmarks, prediction.vertices[:, :-1])
    with pytest.raises(ValueError, match=r"59 vertices and the ground truth 60, .*hand=mano"):
        measure(other, ground_truth)
    with pytest.raises(ValueError, match="without vertices"):
        measure(HandPoints(prediction.landmarks), ground_truth)


def test_it_survives_pickling_and_resets() -> None:
    ground_truth, prediction = hands(4), hands(4, noise=0.01)
    metrics = measure(prediction, ground_truth)
    expected = metrics.compute()
    copy = pickle.loads(pickle.dumps(metrics))  # noqa: S301  # our own bytes
    assert copy.compute() == expected
    metrics.reset()
    metrics.update(prediction[:2], ground_truth[:2], torch.arange(2))
    assert metrics.compute() == approx(measure(prediction[:2], ground_truth[:2]).compute())


def test_a_forward_call_scores_its_batch_and_remembers_it() -> None:
    ground_truth, prediction = hands(4), hands(4, noise=0.01)
    metrics = HandMetrics()
    first = metrics(prediction[:2], ground_truth[:2], torch.arange(2))
    metrics(prediction[2:], ground_truth[2:], torch.arange(2, 4))
    assert first == approx(measure(prediction[:2], ground_truth[:2]).compute())
    assert metrics.compute() == approx(measure(prediction, ground_truth).compute())


def _score_on_one_of_two_processes(rank: int, port: int, samples: list[list[int]]) -> None:
    torch.set_num_threads(1)
    torch.distributed.init_process_group(
        "gloo", init_method=f"tcp://127.0.0.1:{port}", rank=rank, world_size=2
    )
    ground_truth, prediction = hands(5), hands(5, noise=0.01)
    metrics = HandMetrics()
    mine = torch.tensor(samples[rank], dtype=torch.int64)
    if len(mine):
        metrics.update(prediction[mine], ground_truth[mine], mine)
    else:
        metrics._update_count = 1
    scores = metrics.compute()
    local = HandMetrics()
    local.sync_on_compute = local._to_sync = False
    local.update(prediction, ground_truth, torch.arange(5))
    assert scores == approx(local.compute())
    torch.distributed.destroy_process_group()


@pytest.mark.slow
@pytest.mark.parametrize("samples", [[[0, 2, 4], [1, 3, 0]], [[0, 1, 2, 3, 4], []]])
def test_two_real_processes_compute_what_one_does(samples: list[list[int]]) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    start_processes(
        _score_on_one_of_two_processes, args=(port, samples), nprocs=2, start_method="spawn"
    )


def test_a_trainers_mixed_precision_does_not_reach_the_scores() -> None:
    ground_truth, prediction = hands(3), hands(3, noise=0.008)
    expected = measure(prediction, ground_truth).compute()
    with torch.autocast("cpu", torch.bfloat16):
        assert measure(prediction, ground_truth).compute() == expected
