"""Findings of `doctor`: the state of one thing and the command that mends it."""

from dataclasses import dataclass
from typing import Literal

State = Literal["good", "absent", "wrong"]
"""Fine; missing, which may be intended; or present and broken."""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    subject: str
    """The thing that was checked."""
    state: State
    """Its state."""
    found: str
    """The details found, with numbers."""
    cure: str = ""
    """A command to type, or advice; empty where nothing needs to be done."""
