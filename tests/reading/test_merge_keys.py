"""Merge keys of YAML (`<<`) are read as PyYAML reads them, each merged pair counted, each key once."""

from typing import Final

import pytest
import yaml

from hand_recon.reading.limits import Limits
from hand_recon.reading.text import parse_yaml

MERGED: Final = """
base: &base {x: 1, y: 2, z: {deep: [1, 2]}}
more: &more {<<: *base, y: 3}
own first: {y: 4, <<: *more}
of several: {<<: [*more, {x: 9, w: 5}, *base]}
nested:
  <<: *more
  inner:
    <<: *base
merged in place: {<<: {a: 1, b: 2}, b: 3}
no merge key: {"<<": 3}
"""
LONG: Final = f"# {'a line that sends the text to the loader in Python ' * 50}\n"


@pytest.mark.parametrize("before", ["", LONG])
def test_merged_mappings_are_those_of_pyyaml(before: str) -> None:
    found = parse_yaml(before + MERGED, "a.yaml")
    expected = yaml.safe_load(MERGED)
    assert found == expected
    assert [list(one) for one in found.values()] == [list(one) for one in expected.values()]
    assert found["of several"] == {"x": 1, "y": 3, "z": {"deep": [1, 2]}, "w": 5}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a {b: 1, <<: {c: 2}, b: 3}", "the key 'b' is there twice"),
        ("a: {<<: {b: 1, b: 2}}", "the key 'b' is there twice"),
        ("a: {<<: {b: 1}, <<: {c: 2}}", "the key '<<' is there twice"),
        ("a: &a {<<: *a, b: 1}", "a mapping merges itself"),
        ("a: &a {b: {<<: {c: {<<: *a}}}}", "itself"),
        ("a: {<<: [{b: 1}, 2]}", r"a merge key \(<<\) has something else than a mapping"),
        ("a: {<<: 2}", r"a merge key \(<<\) has something else than a mapping"),
    ],
)
@pytest.mark.parametrize("before", ["", LONG])
def test_merge_keys_that_mean_nothing_are_refused(before: str, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"a\.yaml is not complete YAML \(.*{message}"):
        parse_yaml(before + text, "a.yaml")


@pytest.mark.parametrize("merged", ["[*last, *last]", "[*last, {<<: *last}]"])
def test_nested_merges_are_counted_and_not_written_out(
    merged: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each level doubles the pairs: forty would be a million million."""
    monkeypatch.setattr("hand_recon.reading.yaml_loaders.LIMITS", Limits(yaml_values=10_000))
    levels = ["a0: &a0 {x: 1}"]
    levels += [f"a{n}: &a{n} {{<<: {merged.replace('last', f'a{n - 1}')}}}" for n in range(1, 41)]
    with pytest.raises(
        ValueError, match=r"a\.yaml merges \(<<\) more values than 10,000.*yaml_values=100000"
    ):
        parse_yaml("\n".join(levels), "a.yaml")


def test_one_list_of_many_merges_is_counted_before_it_is_written_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("hand_recon.reading.yaml_loaders.LIMITS", Limits(yaml_values=10_000))
    wide = ", ".join(f"k{i}: 1" for i in range(100))
    times = ", ".join(["*a"] * 101)
    with pytest.raises(ValueError, match="more values than 10,000"):
        parse_yaml(f"a: &a {{{wide}}}\nb: {{<<: [{times}]}}", "a.yaml")
    assert len(parse_yaml(f"a: &a {{{wide}}}\nb: {{<<: [*a, *a]}}", "a.yaml")["b"]) == 100
