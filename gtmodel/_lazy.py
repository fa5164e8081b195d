"""Packages whose public names are imported when they are first used: a command starts with what it needs."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from importlib.util import resolve_name
from pathlib import Path
from types import ModuleType
from typing import Any


class _NoSuchName(AttributeError):
    """Python asks a package for its submodules too, and expects this; near names are looked for when a person reads."""

    def __init__(self, package: ModuleType, name: str) -> None:
        super().__init__(name=name, obj=package)
        self.package, self.asked = package, name

    def __str__(self) -> str:
        from .lang.slips import near

        return f"module '{self.package.__name__}' has no attribute '{self.asked}'{near(self.asked, dir(self.package))}"


class _Package(ModuleType):
    """A package that looks its public names up in `_public`: name -> module and attribute, "" for a module itself."""

    _public: dict[str, tuple[str, str]]

    def __getattr__(self, name: str) -> Any:
        if name not in self._public:
            raise _NoSuchName(self, name)
        module, attribute = self._public[name]
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
