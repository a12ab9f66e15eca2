"""`hand-recon <verb> …`: every command of hand_recon behind one name."""

import difflib
import importlib
import sys
from collections.abc import Sequence

from hand_recon import __version__
from hand_recon.command_line.verbs import VERBS


def main(words: Sequence[str] | None = None) -> None:
    """Run the verb that the first word names.

    Args:
        words: The command line; none for this process's own.

    Raises:
        SystemExit: There is no such verb (status 2), or the verb failed.
    """
    words = sys.argv[1:] if words is None else list(words)
    if not words or words[0] in ("-h", "--help", "help"):
        sys.stdout.write(overview())
    elif words[0] == "--version":
        sys.stdout.write(f"hand_recon {__version__}\n")
    elif words[0] in VERBS:
        importlib.import_module(f"hand_recon.{words[0]}").main(words[1:])
    else:
        near = difflib.get_close_matches(words[0], VERBS, 1)
        hint = f"; did you mean {near[0]}?" if near else "."
        sys.stderr.write(f"Unknown verb {words[0]!r}{hint} Verbs are {', '.join(VERBS)}.\n")
        raise SystemExit(2)


def overview() -> str:
    """The verbs with a line each, by what people want to do."""
    lines = [
        "hand-recon <verb> [files] [name=value or --name value …]",
        "Monocular 3D hand reconstruction that learns from 2D landmarks alone.",
    ]
    for group in dict.fromkeys(verb.group for verb in VERBS.values()):
        lines += ["", group]
        lines += [
            f"  {verb.name:<10}{verb.purpose}" for verb in VERBS.values() if verb.group == group
        ]
    lines += [
        "",
        "`hand-recon <verb> --help` shows what a verb takes; `python -m hand_recon.<verb>` is the same.",
        "Begin with: hand-recon fit hands.json, a list of hands of 21 points [u, v] in pixels each.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
