"""What a value holds, as text that another process can compare: numbers to the last bit."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import casadi as ca
import numpy as np

from gtmodel._pickling import dumps
from gtmodel.cgen import generate

CACHES = frozenset({
    "kept", "cache", "made", "_flat", "_content", "_buffers", "_owner", "_symbols", "_time_key", "_smooth",
})  # fmt: skip
DEEPEST = 60


def content(value: Any) -> str:
    """A digest of everything that a value holds, but for caches and what it derives on demand."""
    return hashlib.sha256("\n".join(_lines(value, "", {}, 0)).encode()).hexdigest()


def differing(value: Any, data: bytes) -> list[str]:
    """The lines of the contents of a value and of its copy that differ, for a message."""
    old, new = (list(_lines(x, "", {}, 0)) for x in (value, pickle.loads(data)))
    return [f"{a} | {b}" for a, b in zip(old, new, strict=False) if a != b][:3]


def content_of(data: bytes) -> str:
    """The digest of what a worker loads."""
    return content(pickle.loads(data))


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


def _lines(value: Any, at: str, seen: dict[int, int], depth: int) -> Iterator[str]:
    if value is None or isinstance(value, (bool, int, str, bytes)):
        yield f"{at} {value!r}"
        return
    if isinstance(value, float):
        yield f"{at} {value.hex()}"
        return
    if id(value) in seen or depth > DEEPEST:
        return
    seen[id(value)] = len(seen)
    kind = type(value)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"{at} {value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    elif isinstance(value, (np.generic, complex, ca.DM)):
        yield f"{at} {value!r}"
    elif isinstance(value, (ca.SX, ca.MX)):
        yield f"{at} {value.shape} {hashlib.sha256(str(value).encode()).hexdigest()}"
    elif isinstance(value, ca.Function):
        yield f"{at} {value} {value.n_instructions() if value.class_name() == 'SXFunction' else ''}"
    elif isinstance(value, (type, FunctionType, BuiltinFunctionType, ModuleType)):
        yield f"{at} {getattr(value, '__qualname__', value.__name__)}"
    elif isinstance(value, MethodType):
        yield f"{at} {value.__qualname__}"
        yield from _lines(value.__self__, f"{at}.self", seen, depth + 1)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            name = repr(key) if isinstance(key, (str, int, tuple)) else ""
            yield from _lines(item, f"{at}[{name}]", seen, depth + 1)
    elif isinstance(value, (set, frozenset)):
        yield f"{at} {sorted(map(repr, value))}"
    elif isinstance(value, (list, tuple)):
        yield f"{at} {kind.__name__} of {len(value)}"
        for n, item in enumerate(value):
            yield from _lines(item, f"{at}[{n}]", seen, depth + 1)
    else:
        yield f"{at} {kind.__qualname__}"
        for name in sorted(_names(value)):
            yield from _lines(getattr(value, name, None), f"{at}.{name}", seen, depth + 1)


def _names(value: Any) -> set[str]:
    kind = type(value)
    names = {f.name for f in fields(value)} if is_dataclass(value) else set()
    names |= set(getattr(value, "__dict__", {}))
    for base in kind.__mro__:
        slots = vars(base).get("__slots__", ())
        names |= set([slots] if isinstance(slots, str) else slots)
    derived = {n for base in kind.__mro__ for n, item in vars(base).items() if isinstance(item, cached_property)}
    return names - derived - CACHES - {"__dict__", "__weakref__"}
