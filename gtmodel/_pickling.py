"""Pickling of models and of everything that is made from them, for other processes and for files.

Three things stop the standard module: CasADi's symbols, which mean something only together with the model that declares
them; classes and functions of a notebook, of a file without a package, or made at run time; and what was compiled. So a
`Portable` object pickles in one piece:

- A model is its class and its modifiers, a causal function the model and the names of its variables, a class made by a
  function the function and its arguments. They are made again when loaded.
- Equal models are loaded once in a process, and with them what was compiled: `kept`.
- Expressions are written together, and their symbols replaced by those of the loaded model.
- Classes and functions that no other process can import travel by value: cloudpickle.
"""

from __future__ import annotations

import copyreg
import io
import pickle
import sys
import threading
from collections import deque
from collections.abc import Callable, Hashable
from copy import deepcopy
from functools import cache, cached_property, lru_cache, wraps
from importlib import import_module
from types import ModuleType
from typing import Any, ParamSpec, Protocol, TypeVar
from weakref import WeakKeyDictionary, WeakValueDictionary

P = ParamSpec("P")
T = TypeVar("T")

MOST = 32  # loaded models that nobody else holds; each takes some megabytes with its compiled functions


class Portable:
    """Base class of objects that hold models, symbols or functions: they pickle in one piece."""

    __slots__ = ()

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        return unpacked, (packed(self),)

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        """Return the parts of the object, as `__reduce__` does, without what it derives from them on demand."""
        parts: Any = object.__reduce_ex__(self, 4)
        made, arguments, *rest = parts
        if rest and isinstance(rest[0], dict):
            derived = _derived(type(self))
            rest[0] = {name: value for name, value in rest[0].items() if name not in derived}
        return made, arguments, *rest

    def __copy__(self) -> Any:
        return _copied(self)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return _copied(self, memo)


class PortableError(Exception):
    """Base class of errors that are made of more than their text, which the standard module cannot make again."""

    def __reduce__(self) -> tuple[Any, ...]:
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class Interned(Portable):
    """Base class of immutable objects of which a process loads equal ones once."""

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        return kept, (self._bytes(),)

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        return self._recipe(pickler) if pickler.root is self else (kept, (self._bytes(),))

    def _recipe(self, pickler: Any) -> tuple[Any, ...]:
        """Return the function and arguments that make the object again."""
        raise NotImplementedError

    def _bytes(self) -> bytes:
        return _registered(self, isinstance(self._symbols_from(), Interned))

    def _symbols_from(self) -> Any:
        """Return the object that is loaded for the symbols of this one."""
        return self

    def __copy__(self) -> Any:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return self


class SymbolOwner(Protocol):
    """What declares symbols, a model's scope: `source` is the object that is loaded to get it, None if it has none."""

    @property
    def source(self) -> Any: ...

    def places(self) -> dict[int, Hashable]:
        """Return the place of each symbol by its element hash."""
        ...

    def at_place(self, place: Any) -> Any:
        """Return the symbol at a place."""
        ...


def made_by_call(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function that makes classes: cached, and its classes pickle as the call."""

    @cache
    @wraps(function)
    def made(*arguments: Any) -> Any:
        cls: Any = function(*arguments)  # type: ignore[call-arg]
        cls._made_by = made, arguments
        return cls

    return made  # type: ignore[return-value]


def dumps(value: Any) -> bytes:
    """Return any value of gtmodel, or a task that uses one, as bytes for `pickle.loads` in another process.

    A list of expressions and a user's lambda are written too, which the standard module cannot. Raises
    pickle.PicklingError, with what cannot be sent, for a generator and the like.
    """
    return pickle.dumps(value if isinstance(value, Portable) else _Parcel(value), protocol=5)


class _Parcel:
    def __init__(self, value: Any) -> None:
        self._value = value

    def __reduce__(self) -> tuple[Any, ...]:
        return unpacked, (packed(self._value),)


def packed(value: Any) -> bytes:
    """Return the parts of a value as bytes for `unpacked`. Raises pickle.PicklingError with what cannot be sent."""
    buffer = io.BytesIO()
    pickler = _pickler()(buffer, value)
    try:
        pickler.dump(value)
    except _NotSent:
        raise
    except Exception as error:
        raise _NotSent(_sentence(value, pickler.last, error)) from error
    return pickle.dumps((*pickler.symbols_written(), buffer.getvalue()), protocol=5)


def unpacked(data: bytes) -> Any:
    """Return a new object from what `packed` wrote."""
    owners, written, places, payload = pickle.loads(data)
    piece = _Piece([kept(owner) for owner in owners])
    piece.read(written, places)
    _open.pieces.append(piece)
    try:
        return pickle.loads(payload)
    finally:
        _open.pieces.pop()


def kept(data: bytes) -> Any:
    """Return the one object of this process that `data` describes."""
    value = _alive.get(data)
    if value is None:
        value = _alive[data] = unpacked(data)
        if isinstance(value, Hashable):
            _came_as[value] = data
    _recent.append(value)
    return value


def _registered(value: Any, comes_back: bool = True) -> bytes:
    """Return a value as bytes, the same ones with which it came; coming back, they give the same object."""
    data = _came_as.get(value) if isinstance(value, Hashable) else None
    if data is None:
        data = packed(value)
    if comes_back:
        _alive.setdefault(data, value)
    return data


class _NotSent(pickle.PicklingError):
    pass


class _Piece:
    """Symbols and their owners while one piece is loaded."""

    def __init__(self, sources: list[Any]) -> None:
        self.owners = [source.tree.scope for source in sources]
        self.symbols: list[Any] = []

    def read(self, text: str, places: list[tuple[int, Any] | None]) -> None:
        if not text:
            return
        import casadi as ca

        stream = ca.StringDeserializer(text)
        leaves, count = stream.unpack(), stream.unpack()
        self.symbols = [stream.unpack() for _ in range(count)]
        if any(place is not None for place in places):
            now = [
                leaf if place is None else self.owners[place[0]].at_place(place[1])
                for leaf, place in zip(leaves, places, strict=True)
            ]
            numbers = [n for n, x in enumerate(self.symbols) if isinstance(x, ca.SX)]
            function = ca.Function("read", [ca.vertcat(*leaves)], [self.symbols[n] for n in numbers])
            for n, x in zip(numbers, function.call([ca.vertcat(*now)]), strict=True):
                self.symbols[n] = x


class _Open(threading.local):
    """What this thread is at: pieces being loaded, and classes being written."""

    def __init__(self) -> None:
        self.pieces: list[_Piece] = []
        self.classes: list[type] = []


_open = _Open()
_alive: WeakValueDictionary[bytes, Any] = WeakValueDictionary()
_came_as: WeakKeyDictionary[Any, bytes] = WeakKeyDictionary()
_recent: deque[Any] = deque(maxlen=MOST)


def _symbol(number: int) -> Any:
    return _open.pieces[-1].symbols[number]


def _owner(number: int) -> Any:
    return _open.pieces[-1].owners[number]


@cache
def _pickler() -> Any:
    import cloudpickle  # here, as elsewhere in this module: a start-up without workers does not need it

    class Pickler(cloudpickle.Pickler):
        """Pickles one piece; `root` is its whole, `last` the object that it reached."""

        def __init__(self, file: io.BytesIO, root: Any) -> None:
            super().__init__(file, protocol=5)
            self.root = self.last = root
            self.inside: Any = None  # the owner of symbols that is part of the piece
            self._owners: list[Any] = []
            self._symbols: list[Any] = []
            self._numbers: dict[int, int] = {}

        def reducer_override(self, obj: Any) -> Any:
            self.last = obj
            if isinstance(obj, type):
                return self._class(obj)
            if isinstance(obj, Portable):
                return obj._reduced(self)
            if isinstance(obj, ModuleType) and type(obj) is not ModuleType:  # a package that imports at first use
                return import_module, (obj.__name__,)
            if _is_symbolic(obj):
                if id(obj) not in self._numbers:
                    self._numbers[id(obj)] = len(self._symbols)
                    self._symbols.append(obj)
                return _symbol, (self._numbers[id(obj)],)
            _send_by_value(obj)
            return super().reducer_override(obj)

        def _class(self, cls: type) -> Any:
            if (call := vars(cls).get("_made_by")) is not None:
                return call
            _send_by_value(cls)
            reduced = super().reducer_override(cls)
            if reduced is NotImplemented or cls is self.root or cls in _open.classes:
                return reduced
            _open.classes.append(cls)  # a class may refer to itself
            try:
                return kept, (_registered(cls),)  # once: loading it again would replace its functions
            finally:
                _open.classes.pop()

        def link(self, owner: SymbolOwner) -> tuple[Any, ...]:
            """Write symbols of this owner as its own; return the parts of a reference to the owner."""
            if all(o is not owner for o in self._owners):
                self._owners.append(owner)
            return _owner, (next(n for n, o in enumerate(self._owners) if o is owner),)

        def symbols_written(self) -> tuple[list[bytes], str, list[Any]]:
            """Return the owners, all expressions, and the place of each symbol in them."""
            owners = [packed(o.source) for o in self._owners]
            if not self._symbols:
                return owners, "", []
            import casadi as ca

            columns = [ca.vec(ca.SX(x.nz[:])) for x in self._symbols if isinstance(x, ca.SX)]
            leaves = ca.symvar(ca.vertcat(*columns)) if columns else []
            known = {h: (n, place) for n, o in enumerate(self._owners) for h, place in o.places().items()}
            stream = ca.StringSerializer()
            stream.pack(leaves)
            stream.pack(len(self._symbols))
            for x in self._symbols:
                stream.pack(x)
            return owners, stream.encode(), [known.get(leaf.element_hash()) for leaf in leaves]

    return Pickler


def _is_symbolic(value: Any) -> bool:
    return type(value).__module__ == "casadi.casadi" and type(value).__name__ in ("SX", "MX")


def _send_by_value(value: Any) -> None:
    """Tell cloudpickle if another process cannot import the module of a class or function."""
    name = getattr(value, "__module__", None) if callable(value) else None
    module = sys.modules.get(name) if isinstance(name, str) else None
    if module is not None and name != "__main__" and not _importable(str(name)):
        import cloudpickle

        if name not in cloudpickle.list_registry_pickle_by_value():
            cloudpickle.register_pickle_by_value(module)


@lru_cache(maxsize=1024)
def _importable(name: str) -> bool:
    root = name.partition(".")[0]
    if root in sys.stdlib_module_names or root in sys.builtin_module_names:
        return True
    for finder in sys.meta_path:
        find = getattr(finder, "find_spec", None)
        if find is not None and find(root, None) is not None:
            return True
    return False


@lru_cache(maxsize=1024)
def _derived(cls: type) -> frozenset[str]:
    return frozenset(n for base in cls.__mro__ for n, item in vars(base).items() if isinstance(item, cached_property))


def _copied(value: Any, memo: dict[int, Any] | None = None) -> Any:
    """Copy an object as the module copy does where a class says nothing; with `memo` deeply."""
    parts: Any = object.__reduce_ex__(value, 4)
    new = parts[0](*parts[1])
    state = parts[2]
    if memo is not None:
        memo[id(value)] = new
        state = deepcopy(state, memo)
    if hasattr(new, "__setstate__"):
        new.__setstate__(state)
        return new
    members, slots = state if isinstance(state, tuple) else (state, None)
    if members:
        vars(new).update(members)
    for name, item in (slots or {}).items():
        object.__setattr__(new, name, item)
    return new


def _sentence(value: Any, last: Any, error: Exception) -> str:
    """Return what cannot be sent: the object at which pickling stopped."""
    inner = "" if last is value else f": it holds {_kind(last)}"
    return f"{_kind(value)} cannot be sent to another process{inner}; {type(error).__name__}: {error}"


def _kind(value: Any) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else f"an object of {type(value).__name__}"
