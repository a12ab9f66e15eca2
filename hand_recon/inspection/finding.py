"""What a look at something found, and what to type next."""

from dataclasses import dataclass
from typing import Literal

State = Literal["good", "absent", "wrong"]
"""Fine; not there, which may be as intended; or there and not as it must be."""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    subject: str
    """What was looked at."""
    state: State
    """How it is."""
    found: str
    """What was found, with numbers."""
    cure: str = ""
    """A command or a sentence; empty where nothing needs to be done."""
