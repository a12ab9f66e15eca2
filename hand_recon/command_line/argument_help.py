"""Lets Hydra's command line be built on Python 3.14, whose argparse looks into every help text at once.

Hydra 1.3.8 gives argparse an object that becomes a text when help is shown, which is no text before:
https://github.com/facebookresearch/hydra/issues/3121.
"""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

COMPLETION: Final = "Install or uninstall shell completion."
"""Help of Hydra's flag whose help is no text."""


@contextmanager
def help_is_text() -> Iterator[None]:
    """Give argparse a text where Hydra gives it something else; nothing changes before Python 3.14."""
    if sys.version_info < (3, 14):
        yield
        return
    original = argparse.ArgumentParser.add_argument

    def add_argument(
        parser: argparse.ArgumentParser,
        *names: str,
        **options: Any,  # noqa: ANN401  # argparse's
    ) -> argparse.Action:
        if not isinstance(options.get("help"), str | None):
            options["help"] = COMPLETION
        return original(parser, *names, **options)

    argparse.ArgumentParser.add_argument = add_argument
    try:
        yield
    finally:
        argparse.ArgumentParser.add_argument = original
