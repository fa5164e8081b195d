"""Packages that import their public names at first use, so that a command loads only the modules it needs."""

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

# names that moved and still work for one release: old package -> name -> new package
_MOVED: dict[str, dict[str, str]] = {
    "gtmodel.control.delayed": dict.fromkeys(
        ("ChatterRadius", "CorrectedTool", "chatter_radius", "corrected_depth"), "gtmodel.milling"
    )
}


class _NoSuchName(AttributeError):
    """AttributeError that searches for similar names only when printed: Python raises it for submodules too."""

    def __init__(self, package: ModuleType, name: str) -> None:
        super().__init__(name=name, obj=package)
        self.package, self.asked = package.__name__, name  # a name can be pickled by a worker process, a module cannot

    def __str__(self) -> str:
        from ._near import near

        names = [name for name in dir(sys.modules[self.package]) if not name.startswith("_")]
        longer = [name for name in names if _word(self.asked).search(name)]  # an earlier name, made more precise
        either = "' or '".join(longer)
        hint = f"; did you mean '{either}'?" if 0 < len(longer) <= 3 else near(self.asked, names)
        return f"module '{self.package}' has no attribute '{self.asked}'{hint}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _no_such_name, (self.package, self.asked)


def _word(name: str) -> re.Pattern[str]:
    """Pattern that finds a name as a whole word of a longer name: Mesh in MotionMesh, modes in natural_modes."""
    return re.compile(rf"(?:^|_|(?<=[a-z0-9])(?=[A-Z])){re.escape(name)}(?:$|_|(?=[A-Z]))")


def _no_such_name(package: str, name: str) -> _NoSuchName:
    return _NoSuchName(import_module(package), name)


class _Package(ModuleType):
    """A package that looks up its public names in `_public`: name -> module and attribute, "" for a module itself.

    It imports its other modules at first use too: `gt.motion.elastic` needs no import statement.
    """

    _public: dict[str, tuple[str, str]]

    def __getattr__(self, name: str) -> Any:
        if (package := _MOVED.get(self.__name__, {}).get(name)) is not None:
            warnings.warn(f"{self.__name__}.{name} is {package}.{name} now", DeprecationWarning, stacklevel=2)
            return getattr(import_module(package), name)
        path = f"{self.__name__}.{name}"
        if name not in self._public and (name.startswith("_") or not name.isidentifier() or find_spec(path) is None):
            raise _NoSuchName(self, name)
        module, attribute = self._public.get(name, (path, ""))
        value = getattr(import_module(module), attribute) if attribute else import_module(module)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Python binds a submodule in its package; a public function of the same name takes precedence
        if isinstance(value, ModuleType) and self._public.get(name, ("", ""))[1]:
            return
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self._public})


def public(package: str) -> None:
    """Make the names that a package's __init__ imports in `if TYPE_CHECKING:` its `__all__`, imported at first use.

    Editors and type checkers read the names in that block.
    """
    module = sys.modules[package]
    names = _names(package, Path(str(module.__file__)))
    module.__dict__["_public"] = names
    module.__dict__["__all__"] = sorted({*names, *getattr(module, "__all__", ())})
    module.__class__ = _Package


def hint(module: str, name: str) -> Any:
    """Return a forward reference to the class `name` of a module, for annotations only.

    It stands in the `else` of `if TYPE_CHECKING:`. `typing.get_type_hints` then finds the class and imports it.

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
            assert isinstance(line, ast.ImportFrom), f"{file}:{line.lineno}: expected `from ... import`"
            module = resolve_name("." * line.level + (line.module or ""), package)
            for entry in line.names:
                if line.module is None:
                    names[entry.name] = (f"{package}.{entry.name}", "")
                elif entry.name == "*":
                    names |= _names(module, file.parent / line.module / "__init__.py")
                else:
                    names[entry.asname or entry.name] = (module, entry.name)
    return names
