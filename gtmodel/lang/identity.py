"""Identity of a model for caches: its class, and everything that its methods read from outside.

`equations` is Python code. It may read a global, a variable of the enclosing function, a class attribute, a default
argument, or another function that reads these. Two models of the same class with equal modifiers are the same model
only if all of these are equal. Every cache of results derived from a model uses `Content` as its key.
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

# limit of objects that a class may refer to; a class with more, such as one that calls a large library, is not cached
MOST = 4000
# modules whose contents do not change while a program runs
_FIXED = frozenset({*sys.stdlib_module_names, "gtmodel", "numpy", "casadi", "scipy"}) - {"__main__"}
# functions that read names which do not appear in the code object
_UNSEEN = frozenset({"globals", "locals", "vars", "eval", "exec", "__import__", "import_module"})
# modules, and below functions, that read files, the environment, the clock, random numbers or modules named by a string
_WORLD = frozenset({
    "io", "_io", "os", "posix", "sys", "time", "datetime", "random", "pathlib", "glob", "subprocess", "socket",
    "urllib", "sqlite3", "secrets", "uuid", "tempfile", "importlib",
})  # fmt: skip
_READERS = frozenset({
    "load", "loadtxt", "genfromtxt", "fromfile", "memmap", "loadmat", "random", "from_csv", "from_npz", "read_log",
    "read_recording",
})  # fmt: skip
_PYTHONS = frozenset({"__dict__", "__weakref__", "__doc__", "__module__", "__firstlineno__", "__static_attributes__"})


class Content:
    """The exact content of a value, as a hashable key: 0.0 differs from -0.0, and 1 from True.

    key: equal for equal contents. whole: false if a part may change without notice, such as an open file; the key then
    holds the object itself.
    """

    def __init__(self, value: Any) -> None:
        self.whole = True
        self._numbers: dict[int, int] = {}
        self._names: set[tuple[int, str]] = set()
        self._references: list[Any] = []  # keeps objects alive, so that Python does not reuse their id
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
        if id(value) in self._numbers:
            return ("again", self._numbers[id(value)])
        if len(self._numbers) >= MOST:
            return self._opaque(value)
        self._numbers[id(value)] = len(self._numbers)
        self._references.append(value)
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
            return _Same(value)  # `_named` reads the attributes that a function names
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
            return self._opaque(value)  # already bound: part of a tree with its own symbols
        return self._of_object(value)

    def _of_class(self, cls: type) -> Hashable:
        """Return the content of a user's class: the members of the class and its bases, except Python's own."""
        bases = [base for base in cls.__mro__ if not _is_fixed(base)]
        members = [(base, name, item) for base in bases for name, item in list(vars(base).items())]
        contents = [(base, name, self._of(item)) for base, name, item in members if name not in _PYTHONS]
        return (cls, tuple(contents))

    def _of_function(self, f: FunctionType) -> Hashable:
        identity = _Same(f)
        if _fixed_name(f.__module__ or ""):
            variables = [_cell(c) for c in f.__closure__ or ()]
            return (identity, tuple(map(self._of, variables)))
        read = _read_by(f.__code__)
        defaults = (f.__defaults__, f.__kwdefaults__, tuple(map(_cell, f.__closure__ or ())))
        named = [f.__globals__.get(n, vars(builtins).get(n, _MISSING)) for n in read.names]
        named += [sys.modules.get(m, _MISSING) for m in _absolute(read.imported, f)]
        modules = [*named, *defaults[2]]
        if read.unseen or any(_reads_world(value, read.names) for value in modules):
            self.whole = False
        contents = tuple(x for m in modules if isinstance(m, ModuleType) for x in self._named(m, read.names))
        return (identity, f.__code__, self._of(defaults), tuple(map(self._of, named)), contents)

    def _named(self, module: ModuleType, names: Iterable[str]) -> Iterator[Hashable]:
        """Yield the contents that a function may read from `module`: the attributes whose names occur in its code."""
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
        """Return the content of any other object: its class and its attributes."""
        members = getattr(value, "__dict__", None)
        slots = [n for base in type(value).__mro__ for n in _slots(base) if n not in ("__dict__", "__weakref__")]
        if not isinstance(members, dict) and not slots:
            return (type(value),) if type(value) is object else self._opaque(value)
        if _is_fixed(type(value)) and not type(value).__module__.startswith("gtmodel"):
            return self._opaque(value)
        attributes = {n: getattr(value, n, _MISSING) for n in slots}
        if isinstance(value, Model):
            attributes["_modifiers"] = value.__dict__["_modifiers"]
        elif isinstance(members, dict):
            attributes.update(members)
        return (self._of(type(value)), self._of(attributes))

    def _opaque(self, value: Any) -> Hashable:
        self.whole = False
        return _Same(value)


class _Same:
    """Key of an object that equals only itself; it keeps the object alive."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value


_MISSING = object()


class _Read:
    """The names that a code object and its nested functions read."""

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
    """Return whether code with these names may get another result from a module, class or function at the next call."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    if not isinstance(module, str) or not _fixed_name(module):
        return False
    root = module.partition(".")[0]
    return root in _WORLD or not _READERS.isdisjoint(set(names) - ({"load"} if root == "gtmodel" else set()))


def _absolute(imported: Iterable[str], f: FunctionType) -> Iterator[str]:
    """Yield the full names of imported modules, with relative imports resolved."""
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
