"""Packages whose public names are imported when they are first used: a command starts with what it needs."""

from __future__ import annotations

import ast
import re
import sys
import warnings
from importlib import import_module
from importlib.util import find_spec, resolve_name
from pathlib import Path
from types import ModuleType
from typing import Any, ForwardRef

# names of before that stand elsewhere now, read for one release: package -> name -> package
_MOVED: dict[str, dict[str, str]] = {
    "gtmodel.control.delayed": dict.fromkeys(
        ("ChatterRadius", "CorrectedTool", "chatter_radius", "corrected_depth"), "gtmodel.milling"
    )
}


class _NoSuchName(AttributeError):
    """Python asks a package for its submodules too, and expects this; near names are looked for when a person reads."""

    def __init__(self, package: ModuleType, name: str) -> None:
        super().__init__(name=name, obj=package)
        self.package, self.asked = package.__name__, name  # its name: an error that a worker process sends is pickled

    def __str__(self) -> str:
        from ._near import near

        there = [name for name in dir(sys.modules[self.package]) if not name.startswith("_")]
        longer = [name for name in there if _word(self.asked).search(name)]  # a name of before, made more precise
        either = "' or '".join(longer)
        meant = f"; did you mean '{either}'?" if 0 < len(longer) <= 3 else near(self.asked, there)
        return f"module '{self.package}' has no attribute '{self.asked}'{meant}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _no_such_name, (self.package, self.asked)


def _word(name: str) -> re.Pattern[str]:
    """Finds a name as a whole word of another one, such as Mesh in MotionMesh and modes in natural_modes."""
    return re.compile(rf"(?:^|_|(?<=[a-z0-9])(?=[A-Z])){re.escape(name)}(?:$|_|(?=[A-Z]))")


def _no_such_name(package: str, name: str) -> _NoSuchName:
    return _NoSuchName(import_module(package), name)


class _Package(ModuleType):
    """A package that looks its public names up in `_public`: name -> module and attribute, "" for a module itself.

    Its other modules are imported when they are first used too: `gt.motion.elastic` needs no import of its own.
    """

    _public: dict[str, tuple[str, str]]

    def __getattr__(self, name: str) -> Any:
        if (there := _MOVED.get(self.__name__, {}).get(name)) is not None:
            warnings.warn(f"{self.__name__}.{name} is {there}.{name} now", DeprecationWarning, stacklevel=2)
            return getattr(import_module(there), name)
        own = f"{self.__name__}.{name}"
        if name not in self._public and (name.startswith("_") or not name.isidentifier() or find_spec(own) is None):
            raise _NoSuchName(self, name)
        module, attribute = self._public.get(name, (own, ""))
        value = getattr(import_module(module), attribute) if attribute else import_module(module)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Python binds a submodule in its package; where a function has the same name, the function is meant
        if isinstance(value, ModuleType) and self._public.get(name, ("", ""))[1]:
            return
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self._public})


def public(package: str) -> None:
    """Make the names that a package's __init__ imports in `if TYPE_CHECKING:`, where editors and type checkers read
    them, its `__all__`: from here on each is imported when it is first used."""
    module = sys.modules[package]
    names = _names(package, Path(str(module.__file__)))
    module.__dict__["_public"] = names
    module.__dict__["__all__"] = sorted({*names, *getattr(module, "__all__", ())})
    module.__class__ = _Package


def hint(module: str, name: str) -> Any:
    """The class `name` of a module, for annotations alone: what runs in place of an import in `if TYPE_CHECKING:`, so
    that `typing.get_type_hints` finds the class, and imports it when somebody asks.

    if TYPE_CHECKING:
        from matplotlib.figure import Figure
    else:
        Figure = hint("matplotlib.figure", "Figure")
    """
    return ForwardRef(f"__import__({module!r}, fromlist=[{name!r}]).{name}")


def _names(package: str, file: Path) -> dict[str, tuple[str, str]]:
    names: dict[str, tuple[str, str]] = {}
    for block in ast.parse(file.read_text(encoding="utf-8")).body:
        if not (isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"):
            continue
        for line in block.body:
            assert isinstance(line, ast.ImportFrom), f"{file}:{line.lineno} is no `from ... import`"
            module = resolve_name("." * line.level + (line.module or ""), package)
            for entry in line.names:
                if line.module is None:
                    names[entry.name] = (f"{package}.{entry.name}", "")
                elif entry.name == "*":
                    names |= _names(module, file.parent / line.module / "__init__.py")
                else:
                    names[entry.asname or entry.name] = (module, entry.name)
    return names
