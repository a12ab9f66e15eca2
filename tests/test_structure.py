"""The layout of the package and the tests, and how docstrings begin, read from the source files."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from hand_recon.command_line.verbs import VERBS

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hand_recon"

FOUNDATIONS = {"__init__.py", "__main__.py", "schema.py", "camera.py"}
"""Modules at the top of the package that are no commands."""

BAD_BEGINNING = re.compile(r"(Of|What|How|Whether|Where|Who)\b")
"""First words that no docstring has: it says what the thing is or does, in a noun or a verb."""


def parsed(*folders: str) -> Iterator[tuple[Path, ast.Module]]:
    """Every Python file below the folders, with its path in the repository."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT), ast.parse(path.read_text())


def functions(tree: ast.Module) -> set[str]:
    """Names of the functions at the top of a module."""
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def imported_modules(tree: ast.Module) -> Iterator[str]:
    """Dotted names that a module imports; for `from a import b`, both `a` and `a.b`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and text of every string that stands alone: below a definition, a field or a constant."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.lineno, node.value.value


def test_the_top_of_the_package_holds_commands_schema_and_camera_alone() -> None:
    modules = {path.name: tree for path, tree in parsed("hand_recon") if len(path.parts) == 2}
    assert modules.keys() >= FOUNDATIONS
    assert modules.keys() - FOUNDATIONS - {f"{verb}.py" for verb in VERBS} == set()
    assert all("main" in functions(modules[f"{verb}.py"]) for verb in VERBS)


def test_no_test_module_is_imported() -> None:
    importing = [
        f"{path} imports {name}"
        for path, tree in parsed("tests", "tools", "hand_recon")
        for name in imported_modules(tree)
        if re.search(r"^tests\.(.*\.)?test_\w+$|^test_\w+$", name)
    ]
    assert not importing


def test_no_docstring_begins_with_of_or_a_question_word() -> None:
    beginnings = [
        f"{path}:{line}: {text.splitlines()[0]}"
        for path, tree in parsed("hand_recon", "tools")
        for line, text in docstrings(tree)
        if BAD_BEGINNING.match(text.lstrip())
    ]
    assert not beginnings, "\n".join(beginnings)


@pytest.mark.parametrize(
    ("source", "beginnings"),
    [
        ('"""Of a hand."""', 1),
        ('SIZE = 3\n"""How large."""', 1),
        ('def f():\n    """Whether it is."""', 1),
        ('class A:\n    """A."""\n    x: int\n    """Where it is, metres."""', 1),
        ('"""Offsets, Whole hands and What follows."""', 0),
    ],
)
def test_beginnings_are_found_in_docstrings_of_every_kind(source: str, beginnings: int) -> None:
    texts = [text for _, text in docstrings(ast.parse(source))]
    assert sum(bool(BAD_BEGINNING.match(text)) for text in texts) == beginnings


@pytest.mark.parametrize("name", ["figures.py", "report.py", "progress.py"])
def test_a_file_name_that_says_little_is_used_at_most_once(name: str) -> None:
    assert len(list(PACKAGE.rglob(name))) <= 1
