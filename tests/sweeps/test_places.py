"""A machine's cores and GPUs are divided among the runs of a sweep, each to one of them."""

import pytest

from hand_recon.sweeps.places import Place, places, visible_gpus


def test_one_run_at_a_time_has_the_whole_machine() -> None:
    assert places(None, [0, 1, 2, 3], []) == [Place()]
    assert places(1, [0, 1, 2, 3], ["0", "1"]) == [Place((), "0,1")]


def test_fewer_runs_than_gpus_leave_none_out() -> None:
    found = places(2, [0, 1], ["0", "1", "2", "3"])
    assert [place.gpu for place in found] == ["0,2", "1,3"]
    assert [place.gpu for place in places(3, [0, 1], ["0"])] == ["0", "0", "0"]


def test_two_runs_share_no_core_and_leave_none_out() -> None:
    first, second = places(2, [0, 1, 2, 3, 4], [])
    assert sorted(first.cores + second.cores) == [0, 1, 2, 3, 4]
    assert abs(len(first.cores) - len(second.cores)) == 1


def test_without_a_number_there_is_one_run_per_gpu() -> None:
    found = places(None, list(range(8)), ["0", "3"])
    assert [place.gpu for place in found] == ["0", "3"]
    assert found[1].environment()["CUDA_VISIBLE_DEVICES"] == "3"


def test_minus_one_is_a_run_per_core_and_more_runs_than_cores_share_them() -> None:
    assert [place.cores for place in places(-1, [4, 6], [])] == [(4,), (6,)]
    assert [place.cores for place in places(3, [4, 6], [])] == [(4,), (6,), (4,)]


@pytest.mark.parametrize("number", [0, -2])
def test_a_number_of_runs_that_means_nothing_is_refused(number: int) -> None:
    with pytest.raises(ValueError, match=rf"n_jobs={number}; expected a number of runs at once"):
        places(number, [0], [])


def test_the_gpus_are_those_that_the_environment_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "2, GPU-abc")
    assert visible_gpus() == ["2", "GPU-abc"]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert visible_gpus() == []
