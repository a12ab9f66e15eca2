"""Hydra's command line on a Python whose argparse looks into help texts."""

import argparse
import sys

import pytest
from hydra._internal.utils import get_args_parser

from hand_recon.command_line.argument_help import COMPLETION, help_is_text


def test_help_that_is_no_text_becomes_one_from_python_3_14_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 14))
    original = argparse.ArgumentParser.add_argument
    with help_is_text():
        shown = get_args_parser().format_help()
    assert COMPLETION in " ".join(shown.split())
    assert argparse.ArgumentParser.add_argument is original


def test_nothing_changes_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 13))
    original = argparse.ArgumentParser.add_argument
    with help_is_text():
        assert argparse.ArgumentParser.add_argument is original
