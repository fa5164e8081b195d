"""What a value holds, as a digest that another process can compare: numbers to the last bit."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel._pickling import dumps
from gtmodel.cgen import generate
from gtmodel.compiler.flat import FlatModel
from gtmodel.lang.scope import Scope

# filled on demand, or where an object came from
CACHES = frozenset({"kept", "cache", "made", "_flat", "_content", "_buffers", "_smooth", "where"})
Parts = tuple[str, list[tuple[str, Any]]]


class Digests:
    """Digests of values and of everything inside; an object that refers to itself counts once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, str]] = {}
        self._open: set[int] = set()

    def __call__(self, value: Any) -> str:
        if id(value) in self._known:
            return self._known[id(value)][1]
        if id(value) in self._open:
            return "itself"
        self._open.add(id(value))
        text, inside = parts(value)
        digest = hashlib.sha256("\n".join([text, *(f"{n}: {self(x)}" for n, x in inside)]).encode()).hexdigest()
        self._open.remove(id(value))
        self._known[id(value)] = value, digest  # keeps the object, so that Python does not reuse its id
        return digest


def content(value: Any) -> str:
    """The digest of a value."""
    return Digests()(value)


def trail(value: Any) -> list[tuple[str, str, str]]:
    """Name, text and digest of everything two levels inside, for a message."""
    lines, digest = [], Digests()
    for name, x in [("", value), *parts(value)[1]]:
        for inner, y in [("", x), *parts(x)[1]]:
            lines.append((f"{name}.{inner}", parts(y)[0][:80], digest(y)))
    return lines


def content_of(data: bytes) -> str:
    """The digest of what a worker loads."""
    return content(pickle.loads(data))


def trail_of(data: bytes) -> list[tuple[str, str, str]]:
    """The trail of what a worker loads."""
    return trail(pickle.loads(data))


def sent_again(data: bytes) -> bytes:
    """What a worker loads, sent back."""
    return dumps(pickle.loads(data))


def answers(data: bytes) -> tuple[list[bytes], dict[str, str], bool]:
    """Values of a function in many rows, its C text, and whether loading it twice compiles once."""
    function, rows = pickle.loads(data)
    again, _ = pickle.loads(data)
    with TemporaryDirectory() as folder:
        generate({"f": function}, Path(folder) / "c", name="sent")
        texts = {p.name: p.read_text() for p in sorted((Path(folder) / "c").rglob("*")) if p.is_file()}
    return [np.asarray(x).tobytes() for x in function(*rows)], texts, again is function


def parts(value: Any) -> Parts:
    """The text of a value, and what is inside of it by name."""
    kind = type(value).__qualname__
    if value is None or isinstance(value, (bool, int, str, bytes, np.generic, complex, ca.DM, PurePath)):
        return f"{kind} {value!r}", []
    if isinstance(value, float):
        return value.hex(), []
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes() if not value.dtype.hasobject else value.tolist()}", []
    if isinstance(value, (ca.SX, ca.MX)):
        return f"{value.shape} {value}", []
    if isinstance(value, ca.Function):
        return f"{value} {value.n_instructions() if value.is_a('SXFunction') else ''}", []
    if isinstance(value, (type, FunctionType, BuiltinFunctionType, ModuleType)):
        return getattr(value, "__qualname__", value.__name__), []
    if isinstance(value, MethodType):
        return value.__qualname__, [("self", value.__self__)]
    if isinstance(value, Mapping):
        names = [repr(k) if isinstance(k, (str, int, tuple)) else str(n) for n, k in enumerate(value)]
        return kind, list(zip(names, value.values(), strict=True))
    if isinstance(value, (set, frozenset)):
        return f"{kind} {sorted(map(repr, value))}", []
    if isinstance(value, (list, tuple)):
        return kind, [(str(n), x) for n, x in enumerate(value)]
    if isinstance(value, Scope):
        return f"{value.names} {value.parameter_names}", []
    if isinstance(value, gt.Builder):
        return f"{value.title} {value.names()}", [("items", value.items)]
    if isinstance(value, gt.Model):
        return f"{kind} {value.__dict__.get('_path')}", [("modifiers", value.__dict__.get("_modifiers"))]
    if isinstance(value, FlatModel):
        named = ("variables", "parameters", "equations", "branches", "initial", "energies", "groups")
        return value.title, [(name, getattr(value, name)) for name in named]
    return kind, [(name, getattr(value, name, None)) for name in sorted(_names(value))]


def _names(value: Any) -> set[str]:
    kind = type(value)
    names = {f.name for f in fields(value)} if is_dataclass(value) else set()
    names |= set(getattr(value, "__dict__", {}))
    for base in kind.__mro__:
        slots = vars(base).get("__slots__", ())
        names |= set([slots] if isinstance(slots, str) else slots)
    derived = {n for base in kind.__mro__ for n, item in vars(base).items() if isinstance(item, cached_property)}
    return names - derived - CACHES - {"__dict__", "__weakref__"}
