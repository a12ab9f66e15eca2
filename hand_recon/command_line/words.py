"""From what people type to Hydra's overrides: positional paths, `--options`, quoting, unknown names."""

import difflib
import glob
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hand_recon.command_line.verbs import Verb

LISTS: Final = frozenset({"runs", "input"})
"""Path keys that also take a list, `[a,b]`."""

HYDRA_FLAGS: Final = frozenset(
    {
        "--help", "-h", "--hydra-help", "--version", "--resolve", "--run", "-r", "--multirun", "-m",
        "--shell-completion", "-sc",
    }
)  # fmt: skip
"""Flags that are Hydra's own and take no value."""

HYDRA_OPTIONS: Final = frozenset(
    {
        "--cfg", "-c", "--package", "-p", "--config-path", "-cp", "--config-name", "-cn", "--config-dir",
        "-cd", "--experimental-rerun", "--info", "-i",
    }
)  # fmt: skip
"""Flags that are Hydra's own and take a value, as the next word or after `=`."""

COMPLETION: Final = frozenset({"--shell-completion", "-sc"})

INFO: Final = frozenset({"--info", "-i"})

INFO_TOPICS: Final = frozenset(
    {"all", "config", "defaults", "defaults-tree", "plugins", "searchpath"}
)

MULTIRUN: Final = frozenset({"-m", "--multirun"})

_KEY: Final = re.compile(
    r"(?P<sign>\+\+|\+|~)?(?P<key>[A-Za-z_][\w./@-]*)(?:=(?P<value>.*))?\Z", re.DOTALL
)
_GLOB: Final = re.compile(r"glob\((?P<pattern>.*)\)\Z", re.DOTALL)


class UsageError(ValueError):
    """A command line that cannot be understood; its text says what to type instead."""


def to_overrides(
    words: Sequence[str],
    verb: Verb,
    names: Iterable[str],
    *,
    booleans: Iterable[str] = (),
    groups: Iterable[str] = (),
) -> list[str]:
    """Translate the words after a verb into Hydra's flags and overrides.

    A word without `=` is a path for the verb's next positional key. `--name value`, `--name=value` and
    `name=value` are the same. Values of path keys are quoted, so that any file name works, with `~`
    expanded. Everything else is Hydra's grammar and passes unchanged.

    Args:
        words: The command line after the verb.
        verb: The verb.
        names: First parts of the known keys: top-level keys and groups of the configuration.
        booleans: Keys whose `--name` stands for `name=true`.
        groups: Groups that the defaults list has: `+group=member` means `group=member` for them.

    Raises:
        UsageError: An option is unknown, lacks its value, or there are too many positional words.
    """
    known = _Known(frozenset(names), frozenset(booleans), frozenset(groups))
    return _Translation(verb, known).run(list(words))


@dataclass(frozen=True)
class _Known:
    """The names that a verb's configuration has."""

    names: frozenset[str]
    """First parts of the known keys."""
    booleans: frozenset[str]
    """Keys that are true or false."""
    groups: frozenset[str]
    """Groups of the defaults list."""


class _Translation:
    """State of one translation: what is known and how many positional words came so far."""

    def __init__(self, verb: Verb, known: _Known) -> None:
        self.verb, self.known, self.names = verb, known, known.names
        self.positional = list(verb.positional)
        self.collected: list[str] = []
        self.multirun = False
        self.given: set[str] = set()

    def run(self, words: list[str]) -> list[str]:
        if not COMPLETION.isdisjoint(words):
            # Completion has a grammar of its own.
            return words
        self.multirun = not MULTIRUN.isdisjoint(words)
        # Keys that are given by name are not filled by position.
        named = {_bare(word) for word in words}
        self.positional = [key for key in self.positional if key not in named]
        flags: list[str] = []
        found: list[str] = []
        while words:
            word = words.pop(0)
            (flags if _is_flag(word) else found).extend(self._next(word, words))
        if self.collected:
            values = ",".join(quoted(expanded(word)) for word in self.collected)
            found.append(f"{self.verb.many}=[{values}]")
        # Hydra reads no override after a flag that follows another override.
        return flags + found

    def _next(self, word: str, rest: list[str]) -> list[str]:
        name = word.partition("=")[0]
        if word in HYDRA_FLAGS or (name in HYDRA_OPTIONS and "=" in word):
            return [word]
        if word in HYDRA_OPTIONS:
            # The value of --info may be left out.
            takes = bool(rest) and (word not in INFO or rest[0] in INFO_TOPICS)
            return [word, *([rest.pop(0)] if takes else [])]
        if word == "--":
            return [one for _ in range(len(rest)) for one in self._position(rest.pop(0))]
        if word.startswith("-") and not Path(word).exists():
            return [self._option(word, rest)]
        if self._is_path(word):
            return self._position(word)
        return [self._override(word)]

    def _is_path(self, word: str) -> bool:
        """True if a word is a path for a positional key, not an override."""
        match = _KEY.match(word)
        if match is None:
            return True
        if match["value"] is None:
            # `~key` deletes a default in Hydra's grammar.
            return match["sign"] != "~" or not self._knows(match["key"])
        return not self._knows(match["key"]) and match["sign"] is None and Path(word).exists()

    def _knows(self, key: str) -> bool:
        return re.split(r"[./@]", key, maxsplit=1)[0] in self.names | {"hydra"}

    def _position(self, word: str) -> list[str]:
        if self.verb.many is not None:
            self.collected.append(word)
            return []
        if not self.positional:
            raise UsageError(self._misplaced(word))
        return [self._assignment("", self.positional.pop(0), word, verbatim=True)]

    def _misplaced(self, word: str) -> str:
        if self.verb.positional:
            taken = ", ".join(self.verb.positional)
            return (
                f"Unexpected word {word!r}: `{self.verb.name}` takes {taken} by position, and that was given "
                "already. Write options as name=value or --name value."
            )
        near = _nearest(word, self.names)
        return (
            f"Unexpected word {word!r}: `{self.verb.name}` takes options as name=value or --name value"
            + (f"; did you mean {near}=…?" if near else ".")
        )

    def _option(self, word: str, rest: list[str]) -> str:
        """`--name value`, `--name=value` or `--name` of a boolean."""
        name, equals, value = word.partition("=")
        key = name.lstrip("-").replace("-", "_")
        if not name.startswith("--") or not self._knows(key):
            raise UsageError(self._unknown(name, key))
        if equals:
            return self._assignment("", key, value, verbatim=True)
        if key in self.known.booleans and (not rest or rest[0].lower() not in ("true", "false")):
            return f"{key}=true"
        if not rest:
            raise UsageError(
                f"Option {name} lacks its value: write {name} <value> or {key}=<value>."
            )
        if rest[0].startswith("--") and self._knows(
            rest[0][2:].partition("=")[0].replace("-", "_")
        ):
            raise UsageError(f"Option {name} lacks its value; {rest[0]} is an option itself.")
        return self._assignment("", key, rest.pop(0), verbatim=True)

    def _override(self, word: str) -> str:
        match = _KEY.match(word)
        if match is None or match["value"] is None:
            return word
        if not self._knows(match["key"]):
            raise UsageError(self._unknown(match["key"], match["key"]))
        sign = match["sign"] or ""
        if sign == "+" and match["key"] in self.known.groups:
            sign = ""
        return self._assignment(sign, match["key"], match["value"])

    def _unknown(self, shown: str, key: str) -> str:
        near = _nearest(key, self.names)
        known = ", ".join(sorted(self.names))
        return (
            f"Unknown option {shown!r} of `{self.verb.name}`"
            + (f"; did you mean {near}?" if near else ".")
            + f" Known: {known}."
        )

    def _assignment(self, sign: str, key: str, value: str, *, verbatim: bool = False) -> str:
        """An override; the value of a path key as Hydra reads it back unchanged.

        Args:
            sign: `+`, `++` or nothing.
            key: Configuration key.
            value: Its value as typed.
            verbatim: Whether a path was named by position or option, where no syntax of Hydra's is meant.
        """
        if key in self.verb.path_keys:
            value = self._path_value(key, value, verbatim=verbatim)
        elif key in self.verb.lists and not self.multirun and re.fullmatch(r"[\w, ]+", value):
            value = f"[{value}]"
        return f"{sign}{key}={value}"

    def _path_value(self, key: str, value: str, *, verbatim: bool) -> str:
        """A path quoted for Hydra; sweeps, lists and interpolations in assignments stay Hydra's."""
        if self.multirun and (found := _GLOB.match(value)):
            return ",".join(map(quoted, _globbed(key, found["pattern"])))
        is_list = key in LISTS and re.fullmatch(r"\[.*\]", value, re.DOTALL)
        if is_list and not Path(value).exists():
            return value
        if not verbatim and (value in ("", "null", "???") or _is_hydra_syntax(value)):
            return value
        if self.multirun and "," in value and not Path(expanded(value)).exists():
            return ",".join(quoted(expanded(part)) for part in value.split(","))
        return quoted(expanded(value))


def _is_flag(word: str) -> bool:
    return word in HYDRA_FLAGS or word.partition("=")[0] in HYDRA_OPTIONS


def expanded(value: str) -> str:
    """A path with `~` and `~user` expanded at its beginning; unchanged if there is no such user."""
    return os.path.expanduser(value)


def quoted(value: str) -> str:
    """Quote a string for Hydra, which reads the same string back.

    Backslashes are doubled only where they precede a quote, the only place where Hydra reads an escape.
    """
    inside = re.sub(r"(\\*)'", lambda found: found[1] * 2 + r"\'", value)
    trailing = len(inside) - len(inside.rstrip("\\"))
    # OmegaConf would read a `${` as a reference.
    return "'" + (inside + "\\" * trailing).replace("${", r"\${") + "'"


def _is_hydra_syntax(value: str) -> bool:
    """True if a value is already quoted, a list or an interpolation, and not the name of a file."""
    written = re.fullmatch(r"'.*'|\".*\"|\[.*\]|.*\$\{.*", value, re.DOTALL)
    return written is not None and not Path(expanded(value)).exists()


def _globbed(key: str, pattern: str) -> list[str]:
    """The files that a `glob(…)` of a sweep names."""
    found = sorted(glob.glob(expanded(pattern.strip("'\""))))
    if not found:
        raise UsageError(f"{key}=glob({pattern}) matches no file, so that there is nothing to run.")
    return found


def _bare(word: str) -> str:
    """The key that a word assigns to, in either spelling."""
    name = word.partition("=")[0].lstrip("+")
    return (
        name.lstrip("-").replace("-", "_") if name.startswith("--") else name if "=" in word else ""
    )


def _nearest(name: str, names: Iterable[str]) -> str | None:
    """The known name that is most like a mistyped one."""
    score: Callable[[str], float] = lambda known: difflib.SequenceMatcher(None, name, known).ratio()  # noqa: E731
    candidates = [known for known in names if known in name or score(known) >= 0.6]
    return max(candidates, key=score, default=None)
