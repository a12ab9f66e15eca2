"""Reads a pickle of arrays without running anything in it, in a time that its size bounds.

A pickle is a program for a machine with a stack. Python's own machine fetches the functions and classes that
the program names, and calls them; and it hashes what the program makes a key of, which some twenty nested
tuples of each other make endless. The machine here has the instructions that arrays need and no others.
Names that the caller allows stand for inert records, which keep what they are given; any other name is
refused. Nothing is fetched, called or hashed but text, and every instruction takes as long as what it adds.
"""

import pickletools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

Names = Mapping[tuple[str, str], str]
"""Modules and names that a pickle may ask for, and the kind of record that stands for each."""


class RefusedPickleError(ValueError):
    """The pickle asks for what is not needed, or is none; the message goes on after the file's name."""


@dataclass(slots=True, eq=False, repr=False)
class Record:
    """Keeps what a pickle would have passed to a function or class, and does nothing with it."""

    kind: str
    arguments: tuple[object, ...] = ()
    state: object = None


@dataclass(frozen=True, slots=True)
class _Name:
    """What stands for an allowed function or class."""

    kind: str


def load_inert(data: bytes, names: Names, max_operations: int) -> dict[str, object]:
    """The dictionary in a pickle, its values in records.

    Args:
        data: The pickle.
        names: What it may ask for.
        max_operations: How many instructions it may have: each takes up to some hundred bytes of memory.

    Raises:
        RefusedPickleError: It asks for more, is damaged, or holds no dictionary.
    """
    machine = _Machine(names, len(data))
    try:
        for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
            if count >= max_operations:
                raise _refused(f"has more than {max_operations} instructions")
            machine.step(opcode.name, argument)
        (content,) = machine.take(1)
    except RefusedPickleError:
        raise
    except Exception as error:
        # Damaged bytes raise nearly any exception: what they have in common is that this is no pickle.
        raise RefusedPickleError(
            f"cannot be read as a pickle ({type(error).__name__}: {str(error)[:200]}). "
            "Nothing of it was run."
        ) from error
    if not isinstance(content, dict):
        raise RefusedPickleError(f"holds a {type(content).__name__}, expected a dictionary.")
    return content


def _refused(what: str) -> RefusedPickleError:
    return RefusedPickleError(
        f"is refused: the pickle {what}, which such a file never does. Nothing of it was run."
    )


class _Machine:
    """A stack, the places of marks in it, and a memory of what was made."""

    def __init__(self, names: Names, size: int) -> None:
        self.names = names
        self.size = size
        self.stack: list[object] = []
        self.marks: list[int] = []
        self.memory: dict[object, object] = {}

    def step(self, instruction: str, argument: object) -> None:
        """Do as one instruction says."""
        if instruction in _PUSHES:
            self.stack.append(argument)
        elif instruction in _INSTRUCTIONS:
            _INSTRUCTIONS[instruction](self, argument)
        elif instruction not in _IDLE:
            shown = "" if argument is None else f" {str(argument)[:80]}"
            raise _refused(f"uses {instruction}{shown}")

    def take(self, count: int) -> list[object]:
        """The last things on the stack, which lose their place there."""
        if len(self.stack) < count:
            raise ValueError("it takes more than there is")
        items = self.stack[-count:]
        del self.stack[-count:]
        return items

    def take_marked(self) -> list[object]:
        """All things since the last mark."""
        start = self.marks.pop()
        items = self.stack[start:]
        del self.stack[start:]
        return items

    def find(self, module: object, name: object) -> None:
        """Push what stands for a name, if it is allowed."""
        kind = None
        if isinstance(module, str) and isinstance(name, str):
            kind = self.names.get((module, name))
        if kind is None:
            asked = f"{module}.{name}" if isinstance(module, str) and isinstance(name, str) else "?"
            raise _refused(f"asks for {asked[:160]}")
        self.stack.append(_Name(kind))

    def call(self) -> None:
        """Push a record in the place of a call's result."""
        target, arguments = self.take(2)
        if not isinstance(target, _Name) or not isinstance(arguments, tuple):
            raise _refused(f"calls a {type(target).__name__}")
        self.stack.append(Record(target.kind, arguments))

    def build(self) -> None:
        """Give a record its state."""
        (state,) = self.take(1)
        record = self.stack[-1]
        if not isinstance(record, Record):
            raise _refused(f"gives a state to a {type(record).__name__}")
        record.state = state

    def extend_list(self, entries: list[object]) -> None:
        """Append to the list on the stack."""
        target = self.stack[-1]
        if not isinstance(target, list):
            raise _refused(f"appends to a {type(target).__name__}")
        target.extend(entries)

    def extend_dictionary(self, items: list[object]) -> None:
        """Set keys and values, in turn, of the dictionary on the stack."""
        target = self.stack[-1]
        if not isinstance(target, dict):
            raise _refused(f"sets items of a {type(target).__name__}")
        for key, value in zip(items[::2], items[1::2], strict=True):
            # Text alone: tuples of tuples can take for ever to hash, and whole numbers can be chosen
            # so that their hashes collide.
            if not isinstance(key, str | bytes):
                raise _refused(f"has a {type(key).__name__} for a key")
            target[key if isinstance(key, str) else key.decode("latin1")] = value

    def keep(self, place: object) -> None:
        """Remember what is on the stack."""
        if not isinstance(place, int) or place > self.size:
            raise _refused(f"uses LONG_BINPUT {str(place)[:80]}")
        self.memory[place] = self.stack[-1]

    def new_dictionary(self) -> None:
        """Push a dictionary of all since the last mark."""
        items = self.take_marked()
        self.stack.append({})
        self.extend_dictionary(items)


def _find_written(machine: _Machine, argument: object) -> None:
    module, _, name = str(argument).partition(" ")
    machine.find(module, name)


_PUSHES: Final = frozenset((
    "INT", "LONG", "LONG1", "LONG4", "BININT", "BININT1", "BININT2", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8",
    "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8",
))  # fmt: skip
"""Numbers, text and bytes that stand in the pickle; Python 2's strings come as Latin-1."""

_IDLE: Final = frozenset(("PROTO", "FRAME", "STOP"))

_INSTRUCTIONS: Final[Mapping[str, Callable[[_Machine, object], None]]] = {
    "NONE": lambda machine, _: machine.stack.append(None),
    "NEWTRUE": lambda machine, _: machine.stack.append(True),
    "NEWFALSE": lambda machine, _: machine.stack.append(False),
    "MARK": lambda machine, _: machine.marks.append(len(machine.stack)),
    "EMPTY_TUPLE": lambda machine, _: machine.stack.append(()),
    "TUPLE1": lambda machine, _: machine.stack.append(tuple(machine.take(1))),
    "TUPLE2": lambda machine, _: machine.stack.append(tuple(machine.take(2))),
    "TUPLE3": lambda machine, _: machine.stack.append(tuple(machine.take(3))),
    "TUPLE": lambda machine, _: machine.stack.append(tuple(machine.take_marked())),
    "EMPTY_LIST": lambda machine, _: machine.stack.append([]),
    "LIST": lambda machine, _: machine.stack.append(machine.take_marked()),
    "APPEND": lambda machine, _: machine.extend_list(machine.take(1)),
    "APPENDS": lambda machine, _: machine.extend_list(machine.take_marked()),
    "EMPTY_DICT": lambda machine, _: machine.stack.append({}),
    "DICT": lambda machine, _: machine.new_dictionary(),
    "SETITEM": lambda machine, _: machine.extend_dictionary(machine.take(2)),
    "SETITEMS": lambda machine, _: machine.extend_dictionary(machine.take_marked()),
    # Sets are bookkeeping that nobody reads: what they hold is dropped, not hashed.
    "EMPTY_SET": lambda machine, _: machine.stack.append(Record("set")),
    "ADDITEMS": lambda machine, _: machine.take_marked().clear(),
    "PUT": lambda machine, place: machine.keep(place),
    "BINPUT": lambda machine, place: machine.keep(place),
    "LONG_BINPUT": lambda machine, place: machine.keep(place),
    "MEMOIZE": lambda machine, _: machine.keep(len(machine.memory)),
    "GET": lambda machine, place: machine.stack.append(machine.memory[place]),
    "BINGET": lambda machine, place: machine.stack.append(machine.memory[place]),
    "LONG_BINGET": lambda machine, place: machine.stack.append(machine.memory[place]),
    "GLOBAL": _find_written,
    "STACK_GLOBAL": lambda machine, _: machine.find(*machine.take(2)),
    "REDUCE": lambda machine, _: machine.call(),
    "NEWOBJ": lambda machine, _: machine.call(),
    "BUILD": lambda machine, _: machine.build(),
}
"""All else is refused: extension codes, persistent names, buffers from outside, old classes."""
