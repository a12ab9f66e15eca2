"""PyYAML's safe loaders, of mappings with each key once and of merge keys (`<<`) within limits."""

from collections import Counter
from collections.abc import Hashable
from typing import Any, Final

import yaml

from hand_recon.reading.limits import LIMITS, VARIABLE

_MERGE: Final = "tag:yaml.org,2002:merge"


class _Mappings:
    """Mappings of a loader: each key once, and counted pairs of other mappings that are merged into them."""

    def __init__(self, text: str, path: object) -> None:
        """Start with no pairs.

        Args:
            text: The YAML.
            path: Its file, for messages.
        """
        super().__init__(text)  # type: ignore[call-arg]  # a loader's
        self.path, self.merged = path, 0
        self.whole: dict[int, bool] = {}

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Put the pairs of the mappings that a mapping merges before its own, which replace them.

        Raises:
            ValueError: It has a key twice, merges itself or what is no mapping, or all mappings together
                merge more pairs than `yaml_values` of `LIMITS`.
        """
        if not self.whole.get(id(node), True):
            raise ValueError(f"a mapping merges itself,{node.start_mark}")
        if id(node) in self.whole:
            return
        self.whole[id(node)] = False
        self._refuse_twice(node)
        own = [pair for pair in node.value if pair[0].tag != _MERGE]
        sources = [one for key, value in node.value if key.tag == _MERGE for one in _sources(value)]
        before: list[tuple[yaml.Node, yaml.Node]] = []
        # Of several mappings the first counts, and of equal keys the last.
        for source in reversed(sources):
            self.flatten_mapping(source)
            self._count(len(source.value))
            before += source.value
        node.value = before + own
        super().flatten_mapping(node)  # type: ignore[misc]
        self.whole[id(node)] = True

    def _count(self, pairs: int) -> None:
        self.merged += pairs
        if self.merged > LIMITS.yaml_values:
            most = LIMITS.yaml_values
            raise ValueError(
                f"{self.path} merges (<<) more values than {most:,}, which is the limit. If the file is as "
                f"it should be, set {VARIABLE}=yaml_values={10 * most} in the environment."
            )

    def _refuse_twice(self, node: yaml.MappingNode) -> None:
        constructor: Any = self
        keys = [
            "<<" if key.tag == _MERGE else constructor.construct_object(key, deep=True)
            for key, _ in node.value
        ]
        counts = Counter(key for key in keys if isinstance(key, Hashable))
        twice = [key for key, count in counts.items() if count > 1]
        if twice:
            raise ValueError(f"the key {twice[0]!r:.60} is there twice,{node.start_mark}")


def _sources(value: yaml.Node) -> list[yaml.MappingNode]:
    """Mappings that are merged.

    Raises:
        ValueError: It is neither a mapping nor a list of mappings.
    """
    found = value.value if isinstance(value, yaml.SequenceNode) else [value]
    if not all(isinstance(one, yaml.MappingNode) for one in found):
        raise ValueError(
            f"a merge key (<<) has something else than a mapping or a list of mappings,{value.start_mark}"
        )
    return list(found)


class SafeLoader(_Mappings, yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's own safe loader."""


class FastLoader(_Mappings, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader of libyaml, where it is there."""
