"""The page of all images: whole without a network, safe for any name, and filtered by style rules alone."""

import os
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.visualization.gallery import STATES, GalleryEntry, GalleryHand, write_gallery

VOID = {"meta", "img", "input", "br"}


class Page(HTMLParser):
    """Elements of a page; fails on elements that are not closed in order."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.style = ""
        self.feed(path.read_text("utf-8"))
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "style":
            self.style += data
        elif data.strip():
            self.texts.append(data.strip())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


GOOD = GalleryEntry("a.jpg", "overlays/a.jpg", [GalleryHand("right", "plausible", (), 2.345)])
MIXED = GalleryEntry(
    "b.jpg",
    "overlays/b.jpg",
    [
        GalleryHand("left", "doubtful", ["It is far.", "It is small."], 31.0),
        GalleryHand("right", "not fitted", ["Only 3 landmarks."]),
    ],
)
BROKEN = GalleryEntry("c.jpg", error="c.jpg is a cut off JPEG file. Copy or download it again.")
EMPTY = GalleryEntry("d.jpg", notes=["It holds 3 frames; the first is read."])
ALL = [GOOD, MIXED, BROKEN, EMPTY]


def test_the_page_counts_and_lists_images_hands_and_errors(tmp_path: Path) -> None:
    path = write_gallery(tmp_path / "new", ALL, "Hands of today")
    assert path == tmp_path / "new" / "index.html"
    page = Page(path)
    assert "Hands of today" in page.texts
    assert (
        "4 images, 3 hands; 1 plausible; 1 doubtful; 1 not fitted; 1 image could not be processed."
        in page.texts
    )
    for text in (
        "a.jpg",
        "2.3",
        "31.0",
        "It is far.",
        "It is small.",
        "Only 3 landmarks.",
        BROKEN.error,
    ):
        assert text in page.texts
    assert page.texts.count("no hand found") == 1
    assert EMPTY.notes[0] in page.texts
    # The hand that was not fitted has no residual.
    assert page.texts.count("–") == 1


def test_each_image_is_one_group_of_rows_with_a_row_per_hand(tmp_path: Path) -> None:
    page = Page(write_gallery(tmp_path, ALL, "Hands"))
    assert [group["class"] for group in page.all("tbody")] == [
        "plausible", "doubtful not-fitted", "error", "empty",
    ]  # fmt: skip
    assert [cell["rowspan"] for cell in page.all("th") if "rowspan" in cell] == ["1", "2", "1", "1"]
    # A row of headings, and five rows: the third image has one, the second two.
    assert len(page.all("tr")) == 1 + 5


def test_every_filter_has_a_button_a_label_with_its_count_and_a_rule(tmp_path: Path) -> None:
    page = Page(write_gallery(tmp_path, ALL, "Hands"))
    buttons = [button["id"] for button in page.all("input")]
    assert buttons == ["show-all", *(f"show-{state}" for state in STATES)]
    assert [label["for"] for label in page.all("label")] == buttons
    assert {button["name"] for button in page.all("input")} == {"show"}
    for state in STATES:
        assert f"#show-{state}:checked ~ table tbody:not(.{state})" in page.style
    for text in (
        "all images (4)", "doubtful (1)", "not fitted (1)", "could not be processed (1)",
        "no hand found (1)", "plausible (1)",
    ):  # fmt: skip
        assert text in page.texts


def test_rules_select_what_follows_the_buttons_in_one_parent(tmp_path: Path) -> None:
    names = [name for name, _ in Page(write_gallery(tmp_path, ALL, "Hands")).elements]
    between = names[names.index("input") : names.index("table")]
    assert set(between) == {"input", "label"}


def test_the_page_needs_no_script_and_nothing_from_elsewhere(tmp_path: Path) -> None:
    path = write_gallery(tmp_path, ALL, "Hands")
    page = Page(path)
    assert not page.all("script") + page.all("link") + page.all("iframe")
    assert "url(" not in page.style
    assert "@import" not in page.style
    assert "//" not in path.read_text("utf-8").replace("<!doctype html>", "")
    for image in page.all("img"):
        assert image["loading"] == "lazy"
        assert image["alt"]
        assert not urlsplit(image["src"] or "").scheme


def test_without_images_the_page_says_so(tmp_path: Path) -> None:
    page = Page(write_gallery(tmp_path, [], "Hands"))
    assert "0 images, 0 hands." in page.texts
    assert not page.all("tbody")


def test_ten_thousand_images_are_ten_thousand_lazy_images_of_little_text(tmp_path: Path) -> None:
    entries = [
        GalleryEntry(f"{i}.jpg", f"overlays/{i}.jpg", [GalleryHand("left", "plausible")] * 2)
        for i in range(10_000)
    ]
    path = write_gallery(tmp_path, entries, "Hands")
    content = path.read_text("utf-8")
    assert content.count('loading="lazy"') == 10_000
    assert len(content) < 1_000 * len(entries)


@pytest.mark.parametrize(
    "name",
    [
        "<script>alert(1)</script>.jpg", '"><img src=x onerror=alert(1)>.jpg', "a&b;&lt;.jpg", "it's.jpg",
        "javascript:alert(1).jpg", "Hände 手 🖐 #1?x=%20.jpg", "a\nb.jpg", "</title>", "{{ 7 * 7 }}",
    ],
)  # fmt: skip
def test_names_are_shown_as_they_are_and_cannot_change_the_page(tmp_path: Path, name: str) -> None:
    hand = GalleryHand(name, name, [name], 1.0)
    entries = [
        GalleryEntry(name, f"overlays/{name}", [hand], notes=[name]),
        GalleryEntry(name, error=name),
    ]
    page = Page(write_gallery(tmp_path, entries, name))
    assert [tag for tag, _ in page.elements].count("img") == 1
    assert not page.all("script")
    assert page.texts.count(name) >= 8
    assert not any(key.startswith("on") for _, attributes in page.elements for key in attributes)
    assert name in (page.all("img")[0]["alt"] or "")


@settings(max_examples=40)
@given(st.text(st.characters(exclude_characters="\0/\\", exclude_categories=["Cs"]), min_size=1))
def test_an_address_names_the_file_in_the_folder(name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        page = Page(write_gallery(folder, [GalleryEntry("x", f"overlays/{name}", [])], "Hands"))
    source = page.all("img")[0]["src"] or ""
    parts = urlsplit(source)
    assert (parts.scheme, parts.netloc, parts.query, parts.fragment) == ("", "", "", "")
    assert os.fsdecode(unquote_to_bytes(parts.path)) == f"overlays/{name}"
    assert page.all("a")[0]["href"] == source


def test_a_name_that_is_no_text_is_shown_with_escapes_and_its_bytes_addressed(
    tmp_path: Path,
) -> None:
    name = os.fsdecode(b"h\xe4nd.jpg")
    page = Page(write_gallery(tmp_path, [GalleryEntry(name, name, [])], "Hands"))
    assert page.all("img")[0]["src"] == "h%E4nd.jpg"
    assert "h\\udce4nd.jpg" in page.texts


def test_an_image_with_an_error_is_no_image_without_hands() -> None:
    assert BROKEN.states == {"error"}
    assert EMPTY.states == {"empty"}
    assert MIXED.states == {"doubtful", "not-fitted"}
    # A verdict of another program counts among the hands to trust, and is shown.
    assert GalleryEntry("x", hands=[GalleryHand("left", "fine")]).states == {"plausible"}
