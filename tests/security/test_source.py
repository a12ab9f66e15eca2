"""Calls that run code out of a file, or write outside a folder, are nowhere in the source (SECURITY.md)."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
FOLDERS: Final = ("hand_recon", "hydra_plugins", "tools")

NEVER: Final = frozenset(
    {
        "eval", "exec", "compile", "__import__", "os.system", "os.popen", "pickle.load", "pickle.loads",
        "pickle.Unpickler", "pickle._Unpickler", "pickle._load", "pickle._loads", "_pickle.load",
        "_pickle.loads", "_pickle.Unpickler", "marshal.load", "marshal.loads", "shelve.open", "dill.load",
        "dill.loads", "cloudpickle.load", "cloudpickle.loads", "joblib.load", "pandas.read_pickle",
        "pd.read_pickle", "yaml.unsafe_load", "yaml.full_load", "yaml.load_all", "torch.jit.load",
        "shutil.unpack_archive", "tempfile.mktemp",
    }
)  # fmt: skip
"""Functions and classes that are not called, imported by name or inherited from."""

ALLOWED: Final = {
    ("hand_recon/reading/text.py", "yaml.load"): "its two loaders are subclasses of PyYAML's safe ones",
}  # fmt: skip
"""Calls that look as if they were forbidden, with the reason that they are not."""


LIGHTNING: Final = ("fit", "validate", "test", "predict")
"""Methods of a trainer that read the checkpoint `ckpt_path`."""


def imported(nodes: Iterable[ast.AST]) -> dict[str, str]:
    """Dotted names of modules, functions and classes by the names that they are imported as."""
    names: dict[str, str] = {}
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {one.asname: one.name for one in node.names if one.asname}
        if isinstance(node, ast.ImportFrom):
            names |= {one.asname or one.name: f"{node.module}.{one.name}" for one in node.names}
    return names


def written_out(node: ast.AST, known: dict[str, str]) -> str:
    """Dotted name of a node, from the module that it is imported from."""
    first, dot, rest = ast.unparse(node).partition(".")
    return known.get(first, first) + dot + rest


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
    if last in LIGHTNING and "ckpt_path" in given and given.get("weights_only") != "True":
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


def objections(text: str) -> Iterator[tuple[int, str, str]]:
    """Line, dotted name and reason of everything in a source that there is a reason against."""
    nodes = list(ast.walk(ast.parse(text)))
    known = imported(nodes)
    for node in nodes:
        names = []
        if isinstance(node, ast.Call):
            name = written_out(node.func, known)
            if reason := objection(name, node):
                yield node.lineno, name, reason
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{one.name}" for one in node.names]
        elif isinstance(node, ast.ClassDef):
            names = [written_out(base, known) for base in node.bases]
        yield from (
            (node.lineno, name, f"{name} may run code, under any name")  # type: ignore[attr-defined]
            for name in names if name in NEVER
        )  # fmt: skip


def test_nothing_in_the_source_runs_code_of_a_file_or_unpacks_an_archive_to_the_disk() -> None:
    found = []
    allowed = set()
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            place = str(path.relative_to(ROOT))
            for line, name, reason in objections(path.read_text(encoding="utf-8")):
                if (place, name) in ALLOWED:
                    allowed.add((place, name))
                else:
                    found.append(f"{place}:{line}: {reason}")
    assert not found, "\n".join(found)
    assert allowed == ALLOWED.keys()


@pytest.mark.parametrize(
    "text",
    [
        "eval(x)", "pickle.loads(x)", "torch.load(x)", "torch.load(x, weights_only=False)",
        "trainer.fit(m, ckpt_path=x)", "np.load(x, allow_pickle=True)", "yaml.load(x, Loader=L)",
        "subprocess.run(x, shell=True)", "archive.extractall(x)", "tar.extract(x)", "joblib.load(x)",
        "trainer.validate(m, ckpt_path=x)", "trainer.test(m, ckpt_path=x)",
        "self.trainer.predict(m, ckpt_path=x, weights_only=False)",
        "from pickle import loads", "from pickle import Unpickler as Reader", "from os import system, path",
        "class X(pickle.Unpickler): ...", "class X(Mapping, pickle._Unpickler): ...",
        "import pickle as p\np.loads(x)", "import pickle as p\nclass X(p.Unpickler): ...",
        "from torch import load\nload(x)", "import numpy as n\nn.load(x, allow_pickle=True)",
        "from yaml import unsafe_load", "from joblib import load",
    ],
)  # fmt: skip
def test_each_of_these_would_be_found(text: str) -> None:
    assert len(list(objections(text))) == 1


@pytest.mark.parametrize(
    "text",
    [
        "torch.load(x, weights_only=True)",
        "np.load(x, allow_pickle=False)",
        "model.eval()",
        "re.compile(x)",
        "trainer.test(m, ckpt_path=x, weights_only=True)",
        "trainer.validate(m)",
        "from pickle import dumps",
        "class X(pickle.Pickler): ...",
        "import pickle",
        "from re import compile\ncompile(x)",
    ],
)
def test_what_is_harmless_is_not_found(text: str) -> None:
    assert not list(objections(text))


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
