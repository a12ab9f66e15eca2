"""Pickle interpreter that runs no code from the pickle, in time bounded by the pickle's size.

A pickle is a program for a stack machine. Python's unpickler imports and calls the functions that the program
names, and it hashes dictionary keys, which takes forever for some twenty tuples nested in each other. This
interpreter implements only the instructions that arrays need. Names that the caller allows become inert
records, which store the arguments of the call; any other name is refused. Nothing is imported or called, only
text is hashed, and each instruction's time is bounded by the size of what it adds.
"""

import pickletools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

Names = Mapping[tuple[str, str], str]
"""Allowed pairs of module and name, and the kind of record that replaces each."""


class RefusedPickleError(ValueError):
    """Refused or unreadable pickle; the message continues a sentence that begins with the file's name."""


@dataclass(slots=True, eq=False, repr=False)
class Record:
    """Arguments and state that the pickle passes to a function or class, stored and not used."""

    kind: str
    arguments: tuple[object, ...] = ()
    state: object = None


@dataclass(frozen=True, slots=True)
class _Name:
    """Placeholder for an allowed function or class."""

    kind: str


def load_inert(data: bytes, names: Names, max_operations: int) -> dict[str, object]:
    """Read the dictionary in a pickle, with records as its values.

    Args:
        data: Content of the pickle.
        names: Functions and classes that it may name.
        max_operations: Largest number of instructions; each takes up to a few hundred bytes of memory.

    Raises:
        RefusedPickleError: It names others, has too many instructions, is damaged, or holds no dictionary.
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
        # Damaged bytes can raise almost any exception.
        raise RefusedPickleError(
            f"cannot be read as a pickle ({type(error).__name__}: {str(error)[:200]}). "
            "Nothing of it was run."
        ) from error
    if not isinstance(content, dict):
        raise RefusedPickleError(f"holds a {type(content).__name__}, expected a dictionary.")
    return content


def _refused(what: str) -> RefusedPickleError:
    return RefusedPickleError(
        f"is refused: it {what}, which a pickle of arrays does not need. Nothing of it was run."
    )


class _Machine:
    """State of the interpreter: the stack, positions of marks in it, and the memo."""

    def __init__(self, names: Names, size: int) -> None:
        self.names = names
        self.size = size
        self.stack: list[object] = []
        self.marks: list[int] = []
        self.memo: dict[object, object] = {}

    def step(self, instruction: str, argument: object) -> None:
        """Execute one instruction."""
        if instruction in _PUSHES:
            self.stack.append(argument)
        elif instruction in _INSTRUCTIONS:
            _INSTRUCTIONS[instruction](self, argument)
        elif instruction not in _IDLE:
            shown = "" if argument is None else f" {str(argument)[:80]}"
            raise _refused(f"uses {instruction}{shown}")

    def take(self, count: int) -> list[object]:
        """Pop the last items off the stack."""
        if len(self.stack) < count:
            raise ValueError(f"an instruction pops {count} items of {len(self.stack)}")
        items = self.stack[-count:]
        del self.stack[-count:]
        return items

    def take_marked(self) -> list[object]:
        """Pop all items since the last mark."""
        start = self.marks.pop()
        items = self.stack[start:]
        del self.stack[start:]
        return items

    def find(self, module: object, name: object) -> None:
        """Push the placeholder of an allowed name; refuse others."""
        kind = None
        if isinstance(module, str) and isinstance(name, str):
            kind = self.names.get((module, name))
        if kind is None:
            asked = f"{module}.{name}" if isinstance(module, str) and isinstance(name, str) else "?"
            raise _refused(f"asks for {asked[:160]}")
        self.stack.append(_Name(kind))

    def call(self) -> None:
        """Push a record in place of a call's result."""
        target, arguments = self.take(2)
        if not isinstance(target, _Name) or not isinstance(arguments, tuple):
            raise _refused(f"calls a {type(target).__name__}")
        self.stack.append(Record(target.kind, arguments))

    def build(self) -> None:
        """Set the state of the record on the stack."""
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
        """Add alternating keys and values to the dictionary on the stack."""
        target = self.stack[-1]
        if not isinstance(target, dict):
            raise _refused(f"sets items of a {type(target).__name__}")
        for key, value in zip(items[::2], items[1::2], strict=True):
            # Only text may be a key: nested tuples can take forever to hash, and integers can be chosen so
            # that their hashes collide.
            if not isinstance(key, str | bytes):
                raise _refused(f"has a {type(key).__name__} for a key")
            target[key if isinstance(key, str) else key.decode("latin1")] = value

    def memoize(self, index: object) -> None:
        """Store the last item of the stack in the memo."""
        if not isinstance(index, int) or index > self.size:
            raise _refused(f"uses LONG_BINPUT {str(index)[:80]}")
        self.memo[index] = self.stack[-1]

    def new_dictionary(self) -> None:
        """Push a dictionary of all items since the last mark."""
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
"""Instructions that push a number, text or bytes; Python 2's strings are decoded as Latin-1."""

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
    # Sets hold only chumpy's bookkeeping, which is not read: their items are dropped, not hashed.
    "EMPTY_SET": lambda machine, _: machine.stack.append(Record("set")),
    "ADDITEMS": lambda machine, _: machine.take_marked().clear(),
    "PUT": lambda machine, index: machine.memoize(index),
    "BINPUT": lambda machine, index: machine.memoize(index),
    "LONG_BINPUT": lambda machine, index: machine.memoize(index),
    "MEMOIZE": lambda machine, _: machine.memoize(len(machine.memo)),
    "GET": lambda machine, index: machine.stack.append(machine.memo[index]),
    "BINGET": lambda machine, index: machine.stack.append(machine.memo[index]),
    "LONG_BINGET": lambda machine, index: machine.stack.append(machine.memo[index]),
    "GLOBAL": _find_written,
    "STACK_GLOBAL": lambda machine, _: machine.find(*machine.take(2)),
    "REDUCE": lambda machine, _: machine.call(),
    "NEWOBJ": lambda machine, _: machine.call(),
    "BUILD": lambda machine, _: machine.build(),
}
"""Accepted instructions; extension codes, persistent ids, out-of-band buffers and old classes are refused."""
