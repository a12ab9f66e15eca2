"""Sets that are rendered while they are read give the images of complete sets, or say what stopped them."""

import pickle
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from hand_recon.data.sample_order import SeededShuffle
from hand_recon.data.synthetic import image_store, rendered_ahead
from hand_recon.data.synthetic.datamodule import SyntheticDataModule
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.schema import HandBatch

SIZE, CROP = 10, 32
ORDER = [7, 2, 9, 0, 4, 1, 8, 3, 6, 5]


class Gate:
    """Rendering that stops before a chunk until it is let on, with threads in place of processes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, free: int) -> None:
        self.opened = threading.Event()
        self.chunks: list[tuple[int, ...]] = []
        self.failure: Exception | None = None
        self._free = free
        monkeypatch.setattr(image_store, "CHUNK", 2)
        monkeypatch.setattr(rendered_ahead, "single_threaded_processes", self.threads)
        monkeypatch.setattr(rendered_ahead, "render_chunk", self._render)

    @contextmanager
    def threads(self, count: int) -> Iterator[Executor]:
        with ThreadPoolExecutor(1) as pool:
            yield pool

    def _render(self, chunk: image_store.Chunk) -> object:
        if len(self.chunks) == self._free:
            assert self.opened.wait(60)
            if self.failure is not None:
                raise self.failure
        self.chunks.append(chunk.indices)
        return image_store.render_chunk(chunk)


def opened(folder: Path, order: list[int] | None = ORDER) -> SyntheticHands:
    return SyntheticHands("train", SIZE, CROP, "easy", cache_dir=folder, workers=2, order=order)


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> SyntheticHands:
    folder = tmp_path_factory.mktemp("complete")
    return SyntheticHands("train", SIZE, CROP, "easy", cache_dir=folder)


def assert_same(first: HandBatch, second: HandBatch) -> None:
    for name, value in vars(first).items():
        other = getattr(second, name)
        if isinstance(value, torch.Tensor):
            assert value.dtype == other.dtype, name
            assert torch.equal(value.nan_to_num(-1), other.nan_to_num(-1)), name
        else:
            assert value == other, name


def test_the_first_batch_is_read_before_the_others_are_rendered(
    complete: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch, free=2)
    hands = opened(tmp_path)
    assert len(hands) == SIZE
    assert_same(hands.batch(ORDER[:4]), complete.batch(ORDER[:4]))
    assert not list(tmp_path.glob("*/labels.npz"))
    gate.opened.set()
    assert_same(hands.batch(ORDER[4:]), complete.batch(ORDER[4:]))
    assert gate.chunks == [(7, 2), (9, 0), (4, 1), (8, 3), (6, 5)]
    assert torch.equal(hands.landmarks_3d, complete.landmarks_3d)
    assert (hands.images == complete.images).all()
    assert torch.equal(hands[3].image, complete[3].image)
    assert hands.folder.name == complete.folder.name
    names = sorted(path.name for path in hands.folder.iterdir())
    assert names == ["images.npy", "labels.npz", "manifest.json"]


def test_a_set_in_the_cache_is_not_rendered(
    complete: SyntheticHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("rendered again")

    monkeypatch.setattr(rendered_ahead, "render_chunk", never)
    hands = opened(complete.folder.parent)
    assert_same(hands.batch(ORDER), complete.batch(ORDER))


def test_an_interrupted_rendering_goes_on_in_another_order(
    complete: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch, free=2)
    gate.failure = OSError("no space left")
    gate.opened.set()
    hands = opened(tmp_path)
    with pytest.raises(RuntimeError, match=r"after 4 of 10 images .*no space left.*same command"):
        hands.batch([5])
    with pytest.raises(RuntimeError, match="render_workers=1"):
        hands.landmarks_3d  # noqa: B018
    again = Gate(monkeypatch, free=-1)
    hands = opened(tmp_path, sorted(ORDER))
    assert_same(hands.batch(ORDER), complete.batch(ORDER))
    assert again.chunks == [(1, 3), (4, 5), (6, 8)]


def test_a_set_that_is_still_rendered_is_complete_before_it_is_pickled(
    complete: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch, free=0)
    hands = opened(tmp_path)
    threading.Timer(0.2, gate.opened.set).start()
    copy: SyntheticHands = pickle.loads(pickle.dumps(hands))  # noqa: S301
    assert_same(copy.batch(ORDER), complete.batch(ORDER))


@pytest.mark.parametrize("failure", [None, OSError("no space left")])
def test_a_forked_process_waits_for_the_whole_set(
    complete: SyntheticHands,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    failure: OSError | None,
) -> None:
    gate = Gate(monkeypatch, free=0)
    gate.failure = failure
    hands = opened(tmp_path)
    # As in a process that was forked: the thread is not among its own.
    hands._ahead._process = -1  # type: ignore[union-attr]
    threading.Timer(0.2, gate.opened.set).start()
    if failure is None:
        assert_same(hands.batch(ORDER[:2]), complete.batch(ORDER[:2]))
    else:
        with pytest.raises(RuntimeError, match="ended early in the process that began it"):
            hands.batch(ORDER[:2])


def test_processes_render_what_one_process_renders(
    complete: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(image_store, "CHUNK", 3)
    hands = opened(tmp_path)
    assert_same(hands.batch(ORDER[:3]), complete.batch(ORDER[:3]))
    assert_same(hands.batch(ORDER), complete.batch(ORDER))


def module(folder: Path, *, workers: int) -> SyntheticDataModule:
    return SyntheticDataModule(
        train_size=SIZE, val_size=2, test_size=2, crop_size=CROP, cache_dir=folder, render_workers=2,
        batch_size=2, seed=5, workers=workers,
    )  # fmt: skip


def test_training_images_are_rendered_in_the_order_of_the_first_epoch(
    complete: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch, free=1)
    data = module(tmp_path, workers=0)
    data.setup("fit")
    batches = iter(data.train_dataloader())
    expected = SeededShuffle(range(SIZE), 5).order()
    assert_same(next(batches), complete.batch(expected[:2]))
    gate.opened.set()
    for start, batch in enumerate(batches, start=1):
        assert_same(batch, complete.batch(expected[2 * start : 2 * start + 2]))
    assert len(data.dataset("val")) == 2
    data.dataset("val")[0]
    assert [index for chunk in gate.chunks for index in chunk] == [*expected, 0, 1]


def test_loading_processes_get_complete_sets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("rendered while read")

    gate = Gate(monkeypatch, free=-1)
    monkeypatch.setattr(image_store, "single_threaded_processes", gate.threads)
    monkeypatch.setattr("hand_recon.data.synthetic.dataset.render_ahead", never)
    data = module(tmp_path, workers=1)
    data.setup("validate")
    assert (data.dataset("val").folder / "labels.npz").is_file()  # type: ignore[attr-defined]
