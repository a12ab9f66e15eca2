"""Runs a verb: translates its words, lets Hydra compose the configuration, calls the verb's function."""

import difflib
import gc
import importlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, Final, NoReturn

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from hand_recon.command_line.argument_help import help_is_text
from hand_recon.command_line.composing import composed
from hand_recon.command_line.configuration_files import CONF, booleans, groups, known_names
from hand_recon.command_line.launched import error_prefix, launched_place
from hand_recon.command_line.processor import collection_paused, share_processor
from hand_recon.command_line.resolvers import register_resolvers
from hand_recon.command_line.run_folder import OVERRIDE
from hand_recon.command_line.user_errors import USER_ERRORS, reason_of, report_of_thread
from hand_recon.command_line.verbs import VERBS, Verb
from hand_recon.command_line.words import UsageError, to_overrides

OF_OTHER_PROCESSES: Final = ("hydra.run.dir=.", "hydra.output_subdir=null")
"""Overrides of Hydra that make no folder and no file."""

_WHERE: Final = "(HYDRA_FULL_ERROR=1 in the environment shows the place in the code.)"


def run_verb(
    name: str,
    description: str,
    words: Sequence[str] | None = None,
    *,
    config_name: str | None = None,
    preset: Sequence[str] = (),
) -> None:
    """Run a verb with the words after it.

    Args:
        name: A key of `VERBS`.
        description: Shown above Hydra's help: the docstring of the command's module.
        words: The command line after the verb; none for this process's own.
        config_name: File of `conf`, if it is not called like the verb.
        preset: Overrides that go before the user's.

    Raises:
        SystemExit: The command line cannot be understood (status 2), or the run failed.
    """
    share_processor()
    register_resolvers()
    verb, config_name = VERBS[name], config_name or name
    try:
        overrides = to_overrides(
            sys.argv[1:] if words is None else words,
            verb,
            known_names(config_name),
            booleans=booleans(config_name),
            groups=groups(config_name),
        )
        _check_nested(config_name, overrides)
        overrides += of_other_processes(overrides) if verb.together else ()
    except UsageError as error:
        sys.stderr.write(f"error: {error}\nSee `hand-recon {name} --help`.\n")
        raise SystemExit(2) from error
    if not {"--help", "-h"}.isdisjoint(overrides):
        sys.stdout.write(f"{description.strip()}\n\n")
    run_overrides(name, config_name, [*preset, *overrides])
    if failed_members:
        sys.stderr.write(f"error: {len(failed_members)} failed: {', '.join(failed_members)}.\n")
        raise SystemExit(1)


failed_members: Final[list[str]] = []
"""Names of the runs of this process's sweep that did not finish, which the launcher of the sweep adds."""


def run_overrides(name: str, config_name: str, overrides: Sequence[str]) -> None:
    """Let Hydra compose a configuration and call the verb's function.

    Args:
        name: A key of `VERBS`.
        config_name: File of `conf`.
        overrides: Flags and overrides in Hydra's grammar.

    Raises:
        SystemExit: The run failed.
    """
    register_resolvers()
    # A `_target_` may name a module of the current folder, as with `python -m`, which a console script
    # does not look into.
    if "" not in sys.path and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    # Hydra reads the process's command line.
    sys.argv = [f"hand-recon {name}", *overrides, OVERRIDE]
    # On a full disk a line for a log file cannot be written; the command itself will say so.
    logging.raiseExceptions = False
    threading.excepthook = report_of_thread
    main = hydra.main(version_base="1.3", config_path=CONF, config_name=config_name)
    try:
        with collection_paused(), help_is_text():
            main(_task(VERBS[name]))()
    except BrokenPipeError as error:
        _end_quietly(error)
    except KeyboardInterrupt as error:
        sys.stderr.write("Interrupted. What was finished until then is kept.\n")
        raise SystemExit(130) from error


def _task(verb: Verb) -> Callable[[DictConfig], Any]:
    """The verb's function, imported only when it is called: `--help` needs no torch."""
    module, _, name = verb.entry.partition(":")

    def task(config: DictConfig) -> Any:  # noqa: ANN401  # whatever the verb returns
        # Again, for the processes of a sweep.
        register_resolvers()
        try:
            function = getattr(importlib.import_module(module), name)
            # Paused while the command started.
            gc.enable()
            return function(config)
        except BrokenPipeError as error:
            _end_quietly(error)
        except USER_ERRORS as error:
            # In a sweep Hydra says which run failed.
            if HydraConfig.get().mode == RunMode.MULTIRUN or _wants_traceback(error):
                raise
            prefix = error_prefix() if verb.together else "error"
            sys.stderr.write(f"{prefix}: {reason_of(error)}\n{_WHERE}\n")
            raise SystemExit(1) from error

    return task


def _end_quietly(error: BrokenPipeError) -> NoReturn:
    """End the process: whoever read its output, such as `head`, has enough of it."""
    # Python would complain when it flushes at its end.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    raise SystemExit(141) from error


def _wants_traceback(error: Exception) -> bool:
    """True for an error that the user asked to see whole, or that is a fault of this program."""
    own = isinstance(error, ModuleNotFoundError) and (error.name or "").startswith("hand_recon")
    return own or "HYDRA_FULL_ERROR" in os.environ


def of_other_processes(overrides: Sequence[str]) -> tuple[str, ...]:
    """Overrides for a process that a launcher started beside the first one, which alone has a folder.

    Args:
        overrides: The user's.

    Raises:
        UsageError: It is one of several processes, and the command is a sweep.
    """
    place = launched_place()
    if place.count > 1 and not {"--multirun", "-m"}.isdisjoint(overrides):
        raise UsageError(
            f"{place.launcher} started {place.count} processes of a sweep, each of which would do all of it. "
            f"Start it without {place.launcher}: trainer.devices=2 starts the processes of each run."
        )
    return OF_OTHER_PROCESSES if place.rank else ()


def _check_nested(config_name: str, overrides: Sequence[str]) -> None:
    """Refuse a dotted key that the composed configuration does not have, and name the nearest.

    Hydra refuses such a key as well, without naming the nearest one. Keys with a `+` are meant to be new.

    Raises:
        UsageError: There is no such key.
    """
    dotted = [word for word in overrides if "." in word.partition("=")[0] and word[0] not in "-+~"]
    dotted = [word for word in dotted if not word.startswith("hydra.") and "@" not in word]
    if not dotted or "--multirun" in overrides or "-m" in overrides:
        return
    choices = [word for word in overrides if word not in dotted and word[0] != "-"]
    choices = [word for word in choices if not word.lstrip("+~").startswith("hydra")]
    config = _composed(config_name, choices)
    if config is None:
        return
    for word in dotted:
        _check_key(word.partition("=")[0], config)


def _composed(config_name: str, overrides: list[str]) -> DictConfig | None:
    """Compose the configuration without the dotted overrides; None if that fails: Hydra's run says why."""
    try:
        return composed(config_name, overrides)
    except Exception:  # noqa: BLE001  # Hydra's own run says what is wrong, in its own words.
        return None


def _check_key(key: str, config: DictConfig) -> None:
    node: Any = config
    for depth, part in enumerate(key.split(".")):
        if not isinstance(node, DictConfig):
            return
        # A value that the user must give, `???`, is not `in` its node.
        if part not in node and not OmegaConf.is_missing(node, part):
            known = [str(name) for name in node]
            near = difflib.get_close_matches(part, known, 1)
            before = ".".join(key.split(".")[:depth])
            raise UsageError(
                f"Unknown option {key!r}: {before} has no {part!r}"
                + (f"; did you mean {before}.{near[0]}?" if near else ".")
                + f" It has: {', '.join(sorted(known))}. To add a key, write +{key}=…."
            )
        node = None if OmegaConf.is_missing(node, part) else node._get_node(part)
