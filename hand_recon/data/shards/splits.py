"""Opens shards for training, validation and testing; hands of one group are in one split."""

import glob
import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final
from urllib.parse import urljoin, urlsplit

import numpy as np
from jaxtyping import Int

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.landmarks.splits import AROUND
from hand_recon.data.shards.dataset import ShardedImages, ShardRows
from hand_recon.data.shards.manifest import (
    LARGEST_MANIFEST,
    MANIFEST,
    manifest_of_folder,
    read_manifest,
)
from hand_recon.data.shards.remote import Web, is_url
from hand_recon.data.shards.stores import FolderStore, ShardStore, WebStore
from hand_recon.reading.text import read_bytes

logger = logging.getLogger(__name__)

ORDERS: Final = ("all", "shards")
"""Choices of the order of training hands."""

VERIFY: Final = ("sizes", "sha256")
"""Choices of what is checked of local shards before they are used."""

Places = Path | str | list[Path | str]
"""Folders, manifests, URLs or patterns with `*`."""


@dataclass(frozen=True)
class ShardRecipe:
    """Settings of a dataset of shards.

    Raises:
        ValueError: An option has an unknown value.
    """

    train: Places
    """Shards to train on."""
    val: Places | None = None
    """Shards for validation; None takes a share of the training groups."""
    test: Places | None = None
    """Shards for testing; None takes a share of the training groups."""
    val_fraction: float = 0.1
    """Share of the training groups for validation where no shards are given; as many again for testing."""
    split_seed: int = 0
    """Seed of the split, the same for all seeds of a study."""
    order: str = "all"
    """`all` mixes all hands, by reading single records; `shards` mixes those of a few shards."""
    shards_at_once: int = 4
    """With `order=shards`: shards whose hands are mixed."""
    streams: int | None = None
    """With `order=shards`: processes that read shards of their own; None for all of the training."""
    cache_gb: float = 20.0
    """With `order=shards` and a URL: most gigabytes of downloaded shards that are kept."""
    attempts: int = 5
    """Attempts for each request to a URL."""
    verify: str = "sizes"
    """One of `VERIFY`."""
    crop: CropPolicy = field(default_factory=lambda: CropPolicy(around="joints"))
    """Size and position of the crops."""
    reading: ReadingPolicy = field(default_factory=ReadingPolicy)
    """Folder of downloaded files and the number of damaged images allowed."""

    def __post_init__(self) -> None:
        chosen = (("order", self.order, ORDERS), ("verify", self.verify, VERIFY),
                  ("crop.around", self.crop.around, AROUND))  # fmt: skip
        for key, value, choices in chosen:
            if value not in choices:
                raise ValueError(f"Unknown {key}={value!r}; choose one of {list(choices)}.")
        if not 0 < self.val_fraction < 0.5:
            raise ValueError(
                f"val_fraction={self.val_fraction} must lie between 0 and 0.5, so that images are left to "
                "train on."
            )
        if self.attempts < 1 or self.shards_at_once < 1 or (self.streams or 1) < 1:
            raise ValueError(
                f"attempts={self.attempts}, shards_at_once={self.shards_at_once} and streams={self.streams}; "
                "expected 1 or more."
            )


class ShardSplits:
    """The datasets of a recipe; shards that several splits share are opened once."""

    def __init__(self, recipe: ShardRecipe, landmark_set: str | None = None) -> None:
        """Store the settings; nothing is opened before it is needed.

        Args:
            recipe: The recipe.
            landmark_set: Landmark set that the labels are to follow; None accepts all.
        """
        self.recipe = recipe
        self.landmark_set = landmark_set

    def dataset(self, split: str) -> ShardedImages:
        """The dataset of a split, built on each call.

        Args:
            split: `train`, `val` or `test`.

        Raises:
            FileNotFoundError: There are no shards at a place.
            ValueError: A manifest or shard is damaged, labels follow another landmark set, or there are too
                few images to share.
            ConnectionError: A server cannot be reached.
        """
        recipe = self.recipe
        given = {"train": None, "val": recipe.val, "test": recipe.test}[split]
        if given is not None:
            return self._dataset(self._open(given), None)
        if split == "test":
            logger.warning("No test shards: testing on held-out hands of %s.", recipe.train)
        held_out = recipe.val is None or recipe.test is None
        return self._dataset(self._training, self._shares[split] if held_out else None)

    def _dataset(self, rows: ShardRows, chosen: Int[np.ndarray, " row"] | None) -> ShardedImages:
        recipe = self.recipe
        around = recipe.crop.around
        for store in rows.stores if around in ("joints", "box") else ():
            if store.manifest.around != around:
                raise ValueError(
                    f"The boxes of {store.where} are around={store.manifest.around}, and the crops are to be "
                    f"around={around}. Set data.crop.around={store.manifest.around}, or make the shards with "
                    f"around={around}."
                )
        for store in rows.stores:
            self._check_landmark_set(store)
        crop = replace(recipe.crop, around="box" if around == "joints" else around)
        return ShardedImages(rows, chosen, crop, recipe.reading.max_corrupt)

    def _check_landmark_set(self, store: ShardStore) -> None:
        found = store.manifest.landmark_set
        if None not in (found, self.landmark_set) and found != self.landmark_set:
            raise ValueError(
                f"The labels of {store.where} follow the landmark set {found!r}, and training expects "
                f"{self.landmark_set!r}. Set data.landmark_set={found}, or make the shards with "
                f"landmark_set={self.landmark_set} if that is what the labels follow."
            )

    @cached_property
    def _training(self) -> ShardRows:
        return self._open(self.recipe.train)

    @cached_property
    def _shares(self) -> dict[str, Int[np.ndarray, " row"]]:
        """Rows of the training shards for each split without shards of its own, as `LandmarkSplits` draws."""
        recipe, rows = self.recipe, self._training
        if len(rows.stores) > 1:
            logger.warning(
                "Hands are held out of %d folders of shards, whose groups differ: a person or an image that "
                "is in two of them may be in two splits. If some are, give shards as data.val and data.test.",
                len(rows.stores),
            )
        groups = sum(store.manifest.groups for store in rows.stores)
        of_row = rows.groups()
        own = {"val": recipe.val, "test": recipe.test}
        held_out = [split for split, given in own.items() if given is None]
        count = max(1, round(recipe.val_fraction * groups))
        if groups <= count * len(held_out):
            raise ValueError(
                f"{recipe.train} has {groups} groups of images, too few to train on and to hold some out for "
                f"{' and '.join(held_out)}. Give shards as data.val and data.test, or more images."
            )
        order = np.random.default_rng(recipe.split_seed).permutation(groups)
        split_of_group = np.zeros(groups, dtype=np.uint8)
        for number in range(len(held_out)):
            split_of_group[order[number * count : (number + 1) * count]] = 1 + number
        splits = split_of_group[of_row]
        names = ["train", *held_out]
        return {name: np.flatnonzero(splits == number) for number, name in enumerate(names)}

    def _open(self, places: Places) -> ShardRows:
        listed = places if isinstance(places, list) else [places]
        stores = [store for place in listed for store in self._stores(str(place))]
        return ShardRows(stores)

    def _stores(self, place: str) -> list[ShardStore]:
        if is_url(place):
            return [self._web_store(place)]
        path = Path(place).expanduser()
        found = sorted(glob.glob(str(path))) if glob.has_magic(str(path)) else [str(path)]
        if not found:
            raise FileNotFoundError(
                f"Nothing matches {place}; expected folders of shards or their {MANIFEST}."
            )
        manifests = [manifest_of_folder(Path(one).absolute()) for one in found]
        return [
            FolderStore(path.parent, read_manifest(read_bytes(path), str(path)), self.recipe.verify)
            for path in manifests
        ]

    def _web_store(self, url: str) -> WebStore:
        recipe = self.recipe
        if recipe.reading.folder is None:
            raise ValueError(
                f"{url}: the indices of shards behind a URL are kept in a folder, and there is none; set "
                "data.reading.cache_dir."
            )
        if not urlsplit(url).path.endswith(".json"):
            url = urljoin(url if url.endswith("/") else f"{url}/", MANIFEST)
        web = Web(recipe.attempts)
        manifest = read_manifest(web.content(url, LARGEST_MANIFEST), url)
        cache = recipe.reading.folder.parent / "shards"
        return WebStore(url, manifest, cache, web)


def check_cache(rows: ShardRows, recipe: ShardRecipe, processes: int) -> None:
    """Refuse a cache that cannot hold the shards that are mixed, and would download each of them again.

    Args:
        rows: Training hands.
        recipe: Settings, with `order=shards`.
        processes: Processes of this machine that share the cache.

    Raises:
        ValueError: It cannot.
    """
    remote = [store for store in rows.stores if isinstance(store, WebStore)]
    sizes = [shard.tar.bytes for store in remote for shard in store.manifest.shards]
    # Loading processes are ahead of the training: they may read the next ones while others finish the last.
    shards = min(2 * recipe.shards_at_once * processes, len(sizes))
    needed = shards * max(sizes, default=0) / 1e9
    if needed > recipe.cache_gb:
        raise ValueError(
            f"{remote[0].where} has shards of up to {max(sizes) / 1e6:.3g} MB, {shards} of which are needed "
            f"at a time, and cache_gb={recipe.cache_gb:g}. Set data.cache_gb={1.05 * needed:.2g} or more, or "
            "a smaller data.shards_at_once."
        )
