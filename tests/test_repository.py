"""The repository keeps its promises: everything imports, commands exist, the lock is whole."""

import ast
import importlib
import importlib.metadata
import pkgutil
import re
import sys
import tomllib
from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import hand_recon
from check_large_files import files_of, too_large

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "data" / "README.md"]
INDEX_HOST = re.compile(
    r"(index|find-links|registry|resolved)[-_a-z]*[\"']?\s*[=:]\s*[\"']?(https?|file)://"
    r"|https?://[^\s/]+/(simple|packages)/"
)


def committed_texts() -> dict[str, str]:
    """The text of every file that git has or would add, by path."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: what is committed cannot be told")
    files = [path for path in files_of(ROOT) if (ROOT / path).is_file()]
    return {path: (ROOT / path).read_bytes().decode("utf-8", "ignore") for path in files}


def lock_entries() -> dict[str, list[str]]:
    """The lines below each locked package, by its canonical name; a name can be locked twice."""
    entries: dict[str, list[str]] = {}
    name = ""
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        if found := re.match(r"([A-Za-z0-9._-]+)(\[.*\])?==(\S+)", line):
            name = canonicalize_name(found[1])
            entries.setdefault(name, []).append(f"version {found[3]}")
        elif line.strip().startswith("--hash="):
            entries[name].append(line.strip())
    return entries


def test_every_module_imports() -> None:
    failures = {}
    for module in pkgutil.walk_packages(hand_recon.__path__, "hand_recon."):
        try:
            importlib.import_module(module.name)
        except Exception as error:  # noqa: BLE001  # every failure is reported, not the first
            failures[module.name] = repr(error)
    assert not failures


def test_every_configuration_file_is_a_mapping() -> None:
    files = sorted((ROOT / "conf").rglob("*.yaml"))
    assert not [file for file in files if not isinstance(OmegaConf.load(file), DictConfig)]


def test_every_locked_version_has_hashes() -> None:
    for name, lines in lock_entries().items():
        for line, following in zip(lines, [*lines[1:], ""], strict=True):
            if line.startswith("version"):
                assert following.startswith("--hash=sha256:"), f"{name} {line}"


def test_every_declared_dependency_is_locked_at_a_version_that_is_allowed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    locked = ("train", "detect", "heif", "onnx", "demo", "docs", "dev")
    declared = [*project["dependencies"], *(line for name in locked for line in extras[name])]
    entries = lock_entries()
    for requirement in map(Requirement, declared):
        lines = entries.get(canonicalize_name(requirement.name), [])
        versions = [line.removeprefix("version ") for line in lines if line.startswith("version")]
        assert versions, f"{requirement} is not in requirements.lock: run `make lock`"
        assert all(v in requirement.specifier for v in versions), f"{requirement}: {versions}"


def imported_packages(file: Path) -> set[str]:
    """Top-level names that a module imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return names


NOT_LOCKED = {"pxr": "usd-core", "rerun": "rerun-sdk"}
"""Distributions of packages that are imported for an extra which the locked environment lacks."""


def test_every_imported_package_is_a_declared_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    # What training, the detector, HEIC images and backbones need besides are extras of their own.
    extras = project["optional-dependencies"]
    used = (
        "train", "detect", "heif", "backbone", "timm", "onnx", "demo", "usd", "rerun", "sweeps"
    )  # fmt: skip
    lines = [*project["dependencies"], *(line for name in used for line in extras[name])]
    declared = {canonicalize_name(Requirement(line).name) for line in lines}
    providers = importlib.metadata.packages_distributions()
    for file in (ROOT / "hand_recon").rglob("*.py"):
        for name in imported_packages(file) - sys.stdlib_module_names - {"hand_recon"}:
            found = providers.get(name, [NOT_LOCKED.get(name, name)])
            distributions = {canonicalize_name(distribution) for distribution in found}
            assert distributions & declared, f"{file.relative_to(ROOT)} imports {name}"


def test_no_committed_file_names_a_package_index() -> None:
    naming = {path for path, text in committed_texts().items() if INDEX_HOST.search(text)}
    assert naming <= {"tests/test_repository.py"}, "this file alone names the pattern"


EVERYWHERE = {"/", "/tmp", "/home", "/root", "/opt", "/srv", "/usr/src", "/workspace"}  # noqa: S108  # no file is made
"""Folders that every machine has, so that naming one gives nothing away."""


def test_no_committed_file_names_this_machine() -> None:
    places = {f"{ROOT}/"} | ({f"{ROOT.parent}/"} if str(ROOT.parent) not in EVERYWHERE else set())
    texts = committed_texts().items()
    assert not [path for path, text in texts if any(place in text for place in places)]


def test_every_make_command_in_the_documents_exists() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for document in DOCUMENTS:
        quoted = re.findall(r"(?:^|`)\s*make ([a-z0-9-]+)", document.read_text(), re.MULTILINE)
        assert set(quoted) <= targets, document.name


def test_a_large_file_is_refused_unless_it_is_named(tmp_path: Path) -> None:
    (tmp_path / "small.py").write_bytes(b"x" * 100_000)
    (tmp_path / "weights.bin").write_bytes(b"x" * 100_001)
    (tmp_path / "requirements.lock").write_bytes(b"x" * 100_001)
    complaints = too_large(tmp_path, ["small.py", "weights.bin", "requirements.lock", "deleted.py"])
    assert complaints == ["weights.bin has 100001 bytes, more than its limit of 100000."]


def test_the_installed_package_is_this_checkout() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert Path(hand_recon.__file__).resolve().parent == ROOT / "hand_recon"
    assert importlib.metadata.version("hand_recon") == project["version"]


def test_no_document_has_a_placeholder() -> None:
    placeholder = re.compile(r"FIRST_RUN|TODO|XXX|@@")
    assert not [str(path) for path in DOCUMENTS if placeholder.search(path.read_text())]


def test_every_file_that_a_document_links_to_exists() -> None:
    missing = [
        f"{document.relative_to(ROOT)} links to {target}"
        for document in DOCUMENTS
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", document.read_text())
        if not (document.parent / target).exists()
    ]
    assert not missing
