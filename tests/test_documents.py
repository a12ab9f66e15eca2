"""The documents agree with the tree: anchors, code paths and numbered decisions exist."""

import re
from pathlib import Path

import pytest

from check_large_files import files_of

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "data" / "README.md"]
RECORDS = {int(path.name[:4]): path for path in (ROOT / "docs" / "decisions").glob("[0-9]*.md")}


def anchors(document: Path) -> set[str]:
    """The anchors that a Markdown viewer gives to a document's headings."""
    titles = re.findall(r"^#+ (.+)$", document.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_to_headings_find_one() -> None:
    for document in DOCUMENTS:
        text = document.read_text()
        for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)#([^)]+)\)", text):
            there = document.parent / target if target else document
            assert anchor in anchors(there), f"{document.name} links to {target}#{anchor}"


def test_every_code_path_in_the_documents_exists() -> None:
    """The change log is left out: it names what was there."""
    for document in set(DOCUMENTS) - {ROOT / "CHANGELOG.md"}:
        text = document.read_text()
        for named in re.findall(r"`((?:hand_recon|conf|tests|tools|docs)/[\w/.]*)`", text):
            assert (ROOT / named).exists(), f"{document.name} names {named}"


def test_decisions_are_numbered_without_gaps_and_listed_in_the_index() -> None:
    assert RECORDS
    assert sorted(RECORDS) == list(range(1, len(RECORDS) + 1))
    index = (ROOT / "docs" / "decisions" / "README.md").read_text()
    for number, path in RECORDS.items():
        title, _, entered = path.read_text().splitlines()[:3]
        day = re.match(r"Entered (\d{4}-\d\d-\d\d)[,;]", entered)
        assert day, f"{path.name} does not say when it was entered"
        row = f"| {number} | {day[1]} | [{title.removeprefix(f'# {number}. ')}]({path.name}) |"
        assert index.count(row) == 1, row


def test_every_decision_that_a_file_refers_to_exists() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: what is committed cannot be told")
    for path in files_of(ROOT):
        if path.endswith((".py", ".yaml", ".md")) and (ROOT / path).is_file():
            for number in re.findall(r"\bdecision (\d+)", (ROOT / path).read_text()):
                assert int(number) in RECORDS, f"{path} refers to decision {number}"
