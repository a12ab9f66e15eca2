"""A run of a sweep as a job of submitit, which goes on after a time limit or a preemption."""

import importlib
from dataclasses import dataclass
from typing import Any, Final

from hand_recon.sweeps.attempts import Member, finished_attempt
from hand_recon.sweeps.member_process import Ended, end_all, run_member, wait_for_all
from hand_recon.sweeps.places import Place

GRACE: Final = 60.0
"""Seconds that a training has for its last checkpoint."""


@dataclass
class MemberJob:
    """The run of a member, on the cores and GPUs that the scheduler gives the job."""

    member: Member
    """The run."""

    def __call__(self) -> Ended:
        """Run it; a job that was requeued after the end has nothing left to do."""
        if (folder := finished_attempt(self.member)) is not None:
            return Ended(self.member.name, "finished", folder)
        return run_member(self.member, Place())

    def checkpoint(self) -> Any:  # noqa: ANN401  # submitit's
        """End the training, which saves its last checkpoint, and ask for the job to be submitted again.

        submitit calls it within a signal's handler, when the job is about to be ended.
        """
        end_all()
        wait_for_all(GRACE)
        return importlib.import_module("submitit").helpers.DelayedSubmission(self)
