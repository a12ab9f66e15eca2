"""Errors that a command shows as one message without a traceback, and their messages."""

import errno
import sys
import threading
from typing import Final

from hydra.errors import InstantiationException
from omegaconf.errors import MissingMandatoryValue

USER_ERRORS: Final = (
    ValueError, OSError, ModuleNotFoundError, MissingMandatoryValue, InstantiationException, MemoryError,
)  # fmt: skip
"""Errors whose cause is a file, a setting or the machine, and no fault of this program."""

_KEPT: Final = "What was finished until then is kept."
_DISK: Final = {
    errno.ENOSPC: f"The disk is full. {_KEPT} Free some space, or name a folder on another disk.",
    errno.EDQUOT: f"The quota of the disk is used up. {_KEPT} Free some space, or name a folder on another "
    "disk.",
    errno.EROFS: f"The disk can only be read. {_KEPT} Name a folder that can be written to.",
    errno.EACCES: f"That is not permitted. {_KEPT} Check the permissions, or name another file or folder.",
    errno.EPERM: f"That is not permitted. {_KEPT} Check the permissions, or name another file or folder.",
    errno.EIO: f"The disk has a fault. {_KEPT}",
}
"""Sentences about errors of the file system."""


def reason_of(error: BaseException) -> str:
    """Message of an error; for one that Hydra wraps, such as of a detector's file, the message inside.

    Args:
        error: One of `USER_ERRORS`.
    """
    if isinstance(error, MissingMandatoryValue):
        return f"{str(error).splitlines()[0]}. Give it as <name>=<value>."
    if isinstance(error, InstantiationException) and error.__cause__ is not None:
        return reason_of(error.__cause__)
    if isinstance(error, MemoryError):
        return (
            f"There is not enough memory ({error or 'no size is known'}). {_KEPT} Give fewer or smaller "
            "files at a time, or a smaller batch."
        )
    if isinstance(error, OSError) and error.errno in _DISK:
        where = "" if error.filename is None else f"{error.filename}: "
        return f"{where}{_DISK[error.errno]}"
    return str(error)


def report_of_thread(failure: threading.ExceptHookArgs) -> None:
    """Show an error that ended a thread: one of the disk as its message, any other as a traceback.

    TensorBoard writes in a thread of its own, which a full disk ends.

    Args:
        failure: What `threading.excepthook` is called with.
    """
    if isinstance(failure.exc_value, OSError) and failure.exc_value.errno in _DISK:
        sys.stderr.write(f"error: {reason_of(failure.exc_value)}\n")
        return
    threading.__excepthook__(failure)
