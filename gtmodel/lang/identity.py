"""What a class of models means: the class, and all that its methods read from outside.

`equations` is Python. It may read a global, a variable of the function around it, an attribute of a class, a default,
or another function that reads them. Two models of one class and equal modifiers are the same model only while all of
these are equal. Every cache of what is made from a model asks here.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Hashable, Iterable, Iterator
from dis import get_instructions
from functools import lru_cache
from types import BuiltinFunctionType, CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import casadi as ca
import numpy as np

from .model import Model

# objects that one class may reach; a class that reaches more, such as one that calls a large library, is not shared
MOST = 4000
# what these hold does not change while a program runs
_FIXED = frozenset({*sys.stdlib_module_names, "gtmodel", "numpy", "casadi", "scipy"}) - {"__main__"}
# calls that read by a name that no code object shows
_UNSEEN = frozenset({"globals", "locals", "vars", "eval", "exec", "__import__", "import_module"})
# what reads the world: files, environment, clock, chance, modules by a text; by module, or by names within one
_WORLD = frozenset({
    "io", "_io", "os", "posix", "sys", "time", "datetime", "random", "pathlib", "glob", "subprocess", "socket",
    "urllib", "sqlite3", "secrets", "uuid", "tempfile", "importlib",
})  # fmt: skip
_READERS = frozenset({
    "load", "loadtxt", "genfromtxt", "fromfile", "memmap", "loadmat", "random", "from_csv", "from_npz", "read_log",
    "read_recording",
})  # fmt: skip
_LEFT_OUT = frozenset({"__dict__", "__weakref__", "__doc__", "__module__", "__firstlineno__", "__static_attributes__"})


class Content:
    """What a value says, to the last bit: 0.0 is not -0.0, and 1 is not True.

    key: equal for equal contents. whole: false if something in it may change unseen, such as an open file; it stands in
    the key as the object that it is.
    """

    def __init__(self, value: Any) -> None:
        self.whole = True
        self._places: dict[int, int] = {}
        self._names: set[tuple[int, str]] = set()
        self._held: list[Any] = []  # an object that is gone would leave its number to another one
        self.key: Hashable = self._of(value)

    def _of(self, value: Any) -> Hashable:
        if value is None or isinstance(value, (bool, int, str, bytes)):
            return (type(value), value)
        if isinstance(value, float):
            return ("float", value.hex())
        if isinstance(value, complex):
            return ("complex", value.real.hex(), value.imag.hex())
        if isinstance(value, type) and _is_fixed(value):
            return value
        if id(value) in self._places:
            return ("again", self._places[id(value)])
        if len(self._places) >= MOST:
            return self._opaque(value)
        self._places[id(value)] = len(self._places)
        self._held.append(value)
        return self._of_new(value)

    def _of_new(self, value: Any) -> Hashable:
        if isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
            return ("array", value.dtype.str, value.shape, value.tobytes())
        if type(value) in (list, tuple):
            items: Any = value
            return (type(value), tuple(map(self._of, items)))
        if isinstance(value, (dict, MappingProxyType)):
            return (type(value), tuple((self._of(k), self._of(v)) for k, v in value.items()))
        if isinstance(value, (set, frozenset)):
            return (type(value), frozenset(map(self._of, value)))
        if isinstance(value, type):
            return self._of_class(value)
        if isinstance(value, ModuleType):
            return _Same(value)  # its attributes are read where a function names them
        if isinstance(value, FunctionType):
            return self._of_function(value)
        if isinstance(value, MethodType):
            return ("method", self._of(value.__func__), self._of(value.__self__))
        if isinstance(value, (staticmethod, classmethod)):
            return (type(value), self._of(value.__func__))
        if isinstance(value, property):
            return ("property", self._of(value.fget))
        if isinstance(value, (BuiltinFunctionType, np.ufunc, ca.Function, ca.DM)):
            return _Same(value)
        if isinstance(value, Model) and "_modifiers" not in value.__dict__:
            return self._opaque(value)  # bound already: a part of a tree, with symbols of its own
        return self._of_object(value)

    def _of_class(self, cls: type) -> Hashable:
        """A class of a person: its members and those of its bases, without what Python writes into it."""
        own = [base for base in cls.__mro__ if not _is_fixed(base)]
        members = [(base, name, item) for base in own for name, item in list(vars(base).items())]
        held = [(base, name, self._of(item)) for base, name, item in members if name not in _LEFT_OUT]
        return (cls, tuple(held))

    def _of_function(self, f: FunctionType) -> Hashable:
        same = _Same(f)
        if _fixed_name(f.__module__ or ""):
            closed = [_cell(c) for c in f.__closure__ or ()]
            return (same, tuple(map(self._of, closed)))
        read = _read_by(f.__code__)
        defaults = (f.__defaults__, f.__kwdefaults__, tuple(map(_cell, f.__closure__ or ())))
        named = [f.__globals__.get(n, vars(builtins).get(n, _MISSING)) for n in read.names]
        named += [sys.modules.get(m, _MISSING) for m in _absolute(read.imported, f)]
        modules = [*named, *defaults[2]]
        if read.unseen or any(_reads_world(value, read.names) for value in modules):
            self.whole = False
        inside = tuple(content for m in modules if isinstance(m, ModuleType) for content in self._named(m, read.names))
        return (same, f.__code__, self._of(defaults), tuple(map(self._of, named)), inside)

    def _named(self, module: ModuleType, names: Iterable[str]) -> Iterator[Hashable]:
        """What a function that names `module` may read of it: its attributes of any name in that code."""
        if _fixed_name(module.__name__):
            return
        for name in names:
            value = vars(module).get(name, _MISSING)
            if value is _MISSING or (id(module), name) in self._names:
                continue
            self._names.add((id(module), name))
            yield (name, self._of(value))
            if isinstance(value, ModuleType):
                yield from self._named(value, names)

    def _of_object(self, value: Any) -> Hashable:
        """An object of Python: its class and what it holds."""
        members = getattr(value, "__dict__", None)
        slots = [n for base in type(value).__mro__ for n in _slots(base) if n not in ("__dict__", "__weakref__")]
        if not isinstance(members, dict) and not slots:
            return (type(value),) if type(value) is object else self._opaque(value)
        if _is_fixed(type(value)) and not type(value).__module__.startswith("gtmodel"):
            return self._opaque(value)
        held = {n: getattr(value, n, _MISSING) for n in slots}
        if isinstance(value, Model):
            held["_modifiers"] = value.__dict__["_modifiers"]
        elif isinstance(members, dict):
            held.update(members)
        return (self._of(type(value)), self._of(held))

    def _opaque(self, value: Any) -> Hashable:
        self.whole = False
        return _Same(value)


class _Same:
    """Equal to itself alone, and held so that it stays what it is."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value


_MISSING = object()


class _Read:
    """What a code reads by name, the functions inside it too."""

    def __init__(self, code: CodeType) -> None:
        inner = [_read_by(c) for c in code.co_consts if isinstance(c, CodeType)]
        imported = [i.argval for i in get_instructions(code) if i.opname == "IMPORT_NAME"]
        self.names = tuple(dict.fromkeys([*code.co_names, *(n for r in inner for n in r.names)]))
        self.imported = tuple(dict.fromkeys([*imported, *(m for r in inner for m in r.imported)]))
        self.unseen = not _UNSEEN.isdisjoint(self.names)


@lru_cache(maxsize=4096)
def _read_by(code: CodeType) -> _Read:
    return _Read(code)


def _reads_world(value: Any, names: Iterable[str]) -> bool:
    """Whether a module, class or function may give something else at the next call, to a code of these names."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    if not isinstance(module, str) or not _fixed_name(module):
        return False
    root = module.partition(".")[0]
    return root in _WORLD or not _READERS.isdisjoint(set(names) - ({"load"} if root == "gtmodel" else set()))


def _absolute(imported: Iterable[str], f: FunctionType) -> Iterator[str]:
    """Full names of modules, those that a relative import names too."""
    package = f.__globals__.get("__package__") or ""
    for name in imported:
        yield name
        parts = package.split(".") if package else []
        yield from (".".join([*parts[: n + 1], name]).rstrip(".") for n in range(len(parts)))


def _cell(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not assigned yet
        return _MISSING


def _slots(cls: type) -> tuple[str, ...]:
    slots = vars(cls).get("__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


def _fixed_name(module: str) -> bool:
    return module.partition(".")[0] in _FIXED


def _is_fixed(cls: type) -> bool:
    return _fixed_name(cls.__module__)
