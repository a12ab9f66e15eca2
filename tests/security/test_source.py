"""What could run code out of a file, or write outside a folder, is nowhere in the source (SECURITY.md)."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
FOLDERS: Final = ("hand_recon", "tools")

NEVER: Final = frozenset(
    {
        "eval", "exec", "compile", "__import__", "os.system", "os.popen", "pickle.load", "pickle.loads",
        "pickle.Unpickler", "_pickle.loads", "marshal.load", "marshal.loads", "shelve.open", "dill.load",
        "dill.loads", "cloudpickle.load", "cloudpickle.loads", "joblib.load", "pandas.read_pickle",
        "pd.read_pickle", "yaml.unsafe_load", "yaml.full_load", "yaml.load_all", "torch.jit.load",
        "shutil.unpack_archive", "tempfile.mktemp",
    }
)  # fmt: skip
"""Functions that are not called."""

ALLOWED: Final = {
    ("hand_recon/reading/text.py", "yaml.load"): "its two loaders are subclasses of PyYAML's safe ones",
}  # fmt: skip
"""Calls that look as if they were forbidden, with the reason that they are not."""


def calls(tree: ast.AST) -> Iterator[tuple[int, str, ast.Call]]:
    """Line, dotted name and node of every call."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func), node


def keywords(call: ast.Call) -> dict[str | None, str]:
    """Text of the keyword arguments."""
    return {one.arg: ast.unparse(one.value) for one in call.keywords}


def objection(name: str, call: ast.Call) -> str:
    """Reason against a call; empty without one."""
    given = keywords(call)
    last = name.rpartition(".")[2]
    if name in NEVER:
        return f"{name} may run code"
    if name == "torch.load" and given.get("weights_only") != "True":
        return "torch.load without weights_only=True unpickles"
    if last == "fit" and "ckpt_path" in given and given.get("weights_only") != "True":
        return "Lightning unpickles a checkpoint without weights_only=True"
    if given.get("allow_pickle", "False") != "False":
        return "allow_pickle=True unpickles"
    if name == "yaml.load":
        return "yaml.load with an unknown loader"
    if given.get("shell", "False") != "False":
        return "shell=True runs text of others"
    if last in ("extractall", "extract"):
        return "members of archives are read, never unpacked to the disk"
    return ""


def test_nothing_in_the_source_runs_code_of_a_file_or_unpacks_an_archive_to_the_disk() -> None:
    found = []
    allowed = set()
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            place = str(path.relative_to(ROOT))
            for line, name, call in calls(ast.parse(path.read_text(encoding="utf-8"))):
                if (place, name) in ALLOWED:
                    allowed.add((place, name))
                elif reason := objection(name, call):
                    found.append(f"{place}:{line}: {reason}")
    assert not found, "\n".join(found)
    assert allowed == ALLOWED.keys()


@pytest.mark.parametrize(
    "text",
    [
        "eval(x)", "pickle.loads(x)", "torch.load(x)", "torch.load(x, weights_only=False)",
        "trainer.fit(m, ckpt_path=x)", "np.load(x, allow_pickle=True)", "yaml.load(x, Loader=L)",
        "subprocess.run(x, shell=True)", "archive.extractall(x)", "tar.extract(x)", "joblib.load(x)",
    ],
)  # fmt: skip
def test_each_of_these_would_be_found(text: str) -> None:
    ((_, name, call),) = calls(ast.parse(text))
    assert objection(name, call)


@pytest.mark.parametrize(
    "text",
    [
        "torch.load(x, weights_only=True)",
        "np.load(x, allow_pickle=False)",
        "model.eval()",
        "re.compile(x)",
    ],
)
def test_what_is_harmless_is_not_found(text: str) -> None:
    ((_, name, call),) = calls(ast.parse(text))
    assert not objection(name, call)


def test_the_lock_has_a_digest_for_every_package_and_names_no_index() -> None:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    packages = [number for number, text in enumerate(lines) if text[:1].isalnum()]
    assert len(packages) > 50
    for number in packages:
        assert lines[number].rstrip("\\ ").partition(" ; ")[0].count("==") == 1
        assert "--hash=sha256:" in lines[number + 1]
    assert not [
        text for text in lines if text.startswith(("--index-url", "--extra-index-url", "-i "))
    ]
