"""Lookup of class names: packages, libraries on a path, imports, inherited classes, redeclarations."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .._near import near
from . import reader
from .modifications import NOTHING, Modifier, merged
from .multibody import library as multibody
from .syntax import (
    Argument,
    ClassText,
    Component,
    Extends,
    ModelicaError,
    Modification,
    Place,
    Reference,
    ReferencePart,
)

PREDEFINED = ("Real", "Integer", "Boolean", "String")
LANGUAGE = ("StateSelect", "AssertionLevel")  # types visible in every scope, encapsulated ones included
_BLANKS = r"(?:\s|//[^\n]*\n|/\*.*?\*/)"
# a file with a within clause that names a package
_WITHIN = re.compile(rf"{_BLANKS}*within\b{_BLANKS}*\w", re.DOTALL)
# names after class keywords anywhere in a text: a superset of its classes
_CLASS = re.compile(
    rf"\b(?:class|model|record|block|connector|type|package|function|optimization|operator(?!{_BLANKS}+(?:record|function)\b)){_BLANKS}+"
    r"(\w+|'(?:[^'\\]|\\.)+')", re.DOTALL,
)  # fmt: skip
_BUILT_IN = Path(__file__).with_name("standard.mo")
NOT_LOADED = (
    "; the Modelica Standard Library is not loaded: name its folder in MODELICAPATH, or in library = [...] of a "
    "problem file or of gt.modelica.load"
)


@dataclass(eq=False)
class Space:
    """A class in its enclosing scope: its text, the enclosing class, and redeclared local classes."""

    text: ClassText
    outer: Space | None
    replaced: dict[str, Space] = field(default_factory=dict)
    resolved: dict[str, Space | None] = field(default_factory=dict)
    folder: Path | None = None
    package: Any = None  # the Instance that holds its constants, once accessed
    # of the root: files not yet parsed, by names of classes in them
    waiting: dict[str, list[Path]] = field(default_factory=dict)
    _busy: set[str] = field(default_factory=set)
    modifier: Modifier = NOTHING  # modifier of this class, as in `m(Class(k = 3))`
    limits: tuple[tuple[Modification, Space], ...] = ()  # constrainedby modifications of the class it replaces
    limit: Space | None = None  # constraining class of the class it replaces
    replaces: Space | None = None  # the class that it replaces by redeclaration
    holder: Any = None  # the instance that contains the redeclaration
    derived: Space | None = None  # for an inherited class: the class that inherits and may modify it
    original: Space | None = None  # for an inherited class: the class as declared
    _declared: frozenset[str] | None = None

    def __repr__(self) -> str:
        return f"Space({self.name})"

    @property
    def name(self) -> str:
        """The dotted name."""
        if self.outer is None or not self.outer.text.name:
            return self.text.name
        return f"{self.outer.name}.{self.text.name}"

    @property
    def root(self) -> Space:
        return self if self.outer is None else self.outer.root

    def local_class(self, name: str) -> Space | None:
        """Return a class that is declared in this class or stored in its folder; None if there is none."""
        if name not in self.resolved:
            self._arrived(name)
        if name not in self.resolved:
            text = self.text.classes.get(name)
            path = _in_folder(self.folder, name) if self.folder is not None else None
            declared = text is not None or path is not None
            if name in multibody.NAMES and (builtin_text := multibody.own_text(self.name, name, declared)) is not None:
                # examples of the library are read from its folder
                self.resolved[name] = Space(
                    builtin_text, self, folder=path if path is not None and path.is_dir() else None
                )
            elif self.original is not None and (original_class := self.original.local_class(name)) is not None:
                self.resolved[name] = Space(
                    original_class.text, self, folder=original_class.folder, original=original_class
                )
            elif text is not None:
                self.resolved[name] = Space(text, self)
            elif path is not None:
                self.resolved[name] = _loaded(path, self, name)
            else:
                self.resolved[name] = None
        return self.resolved[name]

    def _arrived(self, name: str) -> None:
        """Parse the files of library folders that contain a class of this name."""
        for file in self.waiting.pop(name, ()):
            for names in self.waiting.values():
                if file in names:
                    names.remove(file)
            _enter(self, [c for c in reader.read(file) if c.within or self.resolved.get(c.name) is None])

    def bases(self) -> Iterator[tuple[Space, Extends]]:
        """Yield the base classes with their extends clauses. Raises ModelicaError for an unknown class."""
        for element in self.text.elements:
            if isinstance(element, Extends) and element.base.parts[0].name not in PREDEFINED:
                yield self.base(element), element

    def base(self, extends: Extends) -> Space:
        """Return the class that an extends clause or short class definition names."""
        first = extends.base.parts[0].name
        key = _key(extends)
        if key not in self.resolved:
            if key in self._busy:
                raise ModelicaError(f"{self.text.name} extends itself", extends.at)
            self._busy.add(key)
            try:
                if first == "ExternalObject":
                    raise ModelicaError(f"{self.name} is an external object, which is not supported", extends.at)
                around = self.outer if self.text.short and self.outer is not None else self
                space = around.find(extends.base, skip=extends if around is self else None)
                if space is self:
                    raise ModelicaError(f"{self.text.name} extends itself", extends.at)
                self.resolved[key] = space
            finally:
                self._busy.discard(key)
        result = self.resolved[key]
        if result is None:
            raise ModelicaError(f"there is no class '{first}' to extend", extends.at)
        return result

    @property
    def declared(self) -> frozenset[str]:
        """Names of its components, declared and inherited."""
        if self._declared is None:
            self._declared = frozenset()  # ends the recursion if a class extends itself
            try:
                inherited = [base.declared for base, _ in self.bases()]
            except ModelicaError:
                self._declared = None
                raise
            local_names = [e.name for e in self.text.elements if isinstance(e, Component)]
            self._declared = frozenset(local_names).union(*inherited)
        return self._declared

    def view(self, extends: Extends) -> Space:
        """Return the base class of an extends clause as inherited here, with redeclarations and modifications."""
        base = self.base(extends)
        arguments = extends.modification.arguments if extends.modification is not None else ()
        package = base.text.restriction == "package"
        changed = (
            self.derived is not None
            or self.text.redeclares
            or any(package or a.redeclared is not None for a in arguments)
        )
        if not changed:
            return base
        key = f"view {extends.at.line} {extends.at.column}"
        if key not in self.resolved:
            fields = {"resolved": {}, "package": None, "_busy": set[str]()}
            self.resolved[key] = replace(base, **fields, derived=self.derived or self, original=base)
        inherited_view = self.resolved[key]
        assert inherited_view is not None
        return inherited_view

    def _changed(self, extends: Extends, name: str, inherited: Space) -> Space:
        """Return an inherited local class with the modifications of the extends clause."""
        key = f"changed {name} {extends.at.line} {extends.at.column}"
        for argument in extends.modification.arguments if extends.modification is not None else ():
            if argument.name[0] != name or key in self.resolved:
                continue
            if isinstance(argument.redeclared, ClassText):
                new = Space(argument.redeclared, self, limits=inherited.bounds, limit=inherited.interface)
                new.replaces = inherited if argument.redeclared is not inherited.text else None
                self.resolved[key] = new
            elif argument.redeclared is None:
                modification = argument.modification
                if len(argument.name) > 1:
                    modification = Modification(
                        argument.at, [Argument(argument.at, argument.name[1:], modification, frozenset())]
                    )
                clause = Extends(argument.at, extends.base, modification)
                text = ClassText(argument.at, name, inherited.text.restriction, elements=[clause], short=True)
                short_class = self.resolved[key] = Space(text, self)
                short_class.resolved[_key(clause)] = inherited
        return self.resolved.get(key) or inherited

    @property
    def bounds(self) -> tuple[tuple[Modification, Space], ...]:
        """Constrainedby modifications, which apply to every class that replaces this one."""
        written = self.text.constraint
        if written is not None and written.modification is not None and self.outer is not None:
            return ((written.modification, self.outer),)
        return self.limits

    @property
    def interface(self) -> Space:
        """The constraining class: every class that replaces this one must be a subtype of it."""
        if self.text.constraint is not None and self.outer is not None:
            return self.outer.find(self.text.constraint.base)
        return self if self.limit is None else self.limit

    def member(self, name: str, skip: Extends | None = None) -> Space | None:
        """Return a local class, declared or inherited; with the modifications of the class that inherits this one."""
        local = self._member(name, skip)
        if local is None or self.derived is None or name in self.replaced:
            return local
        return self.derived._member(name) or local

    def _member(self, name: str, skip: Extends | None = None) -> Space | None:
        if name in self.replaced:
            return self.replaced[name]
        if (local := self.local_class(name)) is not None:
            return local
        if name in self._busy or skip is not None:  # a base class is not looked up among inherited classes
            return None
        self._busy.add(name)
        try:
            for element in self.text.elements:
                if not isinstance(element, Extends) or element.base.parts[0].name in PREDEFINED:
                    continue
                if (inherited := self.view(element)._member(name)) is not None:
                    return self._changed(element, name, inherited)
        finally:
            self._busy.discard(name)
        return None

    def imported(self, name: str) -> Space | None:
        for item in self.text.imports:
            if item.name == name:
                return self.root.absolute(item.reference)
        wildcards = [i for i in self.text.imports if not i.name]
        candidates = [c for i in wildcards if (c := self.root.absolute(i.reference).member(name)) is not None]
        if len({id(c.text) for c in candidates}) > 1:
            raise ModelicaError(f"'{name}' is imported from several packages", wildcards[0].at)
        return candidates[0] if candidates else None

    def lookup(self, name: str, skip: Extends | None = None) -> Space | None:
        """Look up the first part of a class name in this and all enclosing scopes; None if there is none."""
        space: Space | None = self
        while space is not None:
            known = space.member(name, skip if space is self else None) or space.imported(name)
            if known is not None:
                return known
            if "encapsulated" in space.text.prefixes:
                space = space.root
                continue
            space = space.outer
        return None

    def find(self, reference: Reference, skip: Extends | None = None) -> Space:
        """Return the class that a reference names. Raises ModelicaError if there is none."""
        if reference.absolute:
            return self.root.absolute(reference)
        first = reference.parts[0].name
        space = self.lookup(first, skip)
        if space is None:
            hint = self._inherited_import(first) or near(first, self.names())
            raise ModelicaError(f"there is no class '{first}'{hint}", reference.at)
        try:
            return space.inside(reference, 1)
        except ModelicaError:
            # public files use the name of an enclosing package although a local or imported class hides it
            farther = self.outer.lookup(first) if self.outer is not None else None
            for other in (farther, self.root.local_class(first)):
                if other is not None and other is not space:
                    return other.inside(reference, 1)
            raise

    def _inherited_import(self, name: str) -> str:
        """The advice for a name that only a base class, or what is around that one, imports."""
        try:
            left = [base for base, _ in self.bases()]
            seen: list[Space] = []
            while left:
                heir = left.pop()
                if heir in seen:
                    continue
                left += [base for base, _ in heir.bases()]
                around: Space | None = heir
                while around is not None:
                    seen.append(around)
                    for item in around.text.imports:
                        if item.name == name:
                            return (
                                f"; imports are not inherited: {around.name} imports it in line {item.at.line}; write "
                                f"import {name} = {item.reference}; in {self.name} too"
                            )
                    around = around.outer
        except ModelicaError:
            pass  # of an extends clause, which is told where it is read
        return ""

    def absolute(self, reference: Reference) -> Space:
        return self.root.inside(reference, 0)

    def inside(self, reference: Reference, begin: int) -> Space:
        space = self
        for part in reference.parts[begin:]:
            following = space.member(part.name)
            if following is None and space.name == "Modelica.Icons":  # contains graphics only
                following = space.resolved[part.name] = Space(ClassText(space.text.at, part.name, "class"), space)
            if following is None:
                if reason := multibody.refusal(space.name, part.name):
                    raise ModelicaError(reason, reference.at)
                where = space.name or "the parsed files"
                names = [*space.text.classes, *(space.resolved if space.outer is None else ())]
                hint = near(part.name, names)
                if not hint and space.text.at.source.path == str(_BUILT_IN):
                    hint = NOT_LOADED
                raise ModelicaError(f"there is no class '{part.name}' in {where}{hint}", reference.at)
            space = following
        return space

    def names(self) -> list[str]:
        """Return the names of classes visible here, for suggestions."""
        result: list[str] = [*PREDEFINED]
        space: Space | None = self
        while space is not None:
            result += [*space.text.classes, *space.waiting]
            space = space.outer
        return result

    def with_replaced(self, replaced: dict[str, Space], instance: Any) -> Space:
        """Return this class for one instance, with some local classes replaced."""
        classes = {**self.replaced, **replaced}
        return replace(self, replaced=classes, resolved={}, _busy=set(), package=instance)

    def with_modifier(self, modifier: Modifier) -> Space:
        """Return this class with a modification from outside."""
        return replace(self, resolved={}, _busy=set(), modifier=merged(modifier, self.modifier))


def _key(extends: Extends) -> str:
    return f"extends {extends.base} {extends.at.line} {extends.at.column}"


def library(paths: Iterable[str | os.PathLike[str]]) -> Space:
    """Return the root scope: classes of files and library folders, of which later ones hide earlier ones.

    Built-in classes are added if no library declares them. Raises ModelicaError for a path without classes.
    """
    at = Place(reader.Source("", ""), 1, 1)
    root = Space(ClassText(at, "", "package"), None)
    for path in paths:
        _add(root, Path(path))
    _enter(root, [c for c in reader.read(_BUILT_IN) if c.name not in root.waiting and root.local_class(c.name) is None])
    return root


def files_of(root: Space) -> list[Path]:
    """Return the files whose classes were parsed so far, without the built-in file."""
    files: set[Path] = set()
    visited: set[int] = set()
    pending = [root]
    while pending:
        space = pending.pop()
        if id(space) not in visited:
            visited.add(id(space))
            pending += [s for s in space.resolved.values() if s is not None]
            if path := space.text.at.source.path:
                files.add(Path(path))
    return sorted(files - {_BUILT_IN})


def of_text(text: str, paths: Iterable[str | os.PathLike[str]] = (), path: str = "") -> tuple[Space, list[ClassText]]:
    """Return the root scope as `library`, with the classes of a text added, and these classes."""
    root = library(paths)
    classes = reader.known(text, path)
    _enter(root, classes)
    file = Path(path)
    if file.name == "package.mo":
        for item in classes:
            name = tuple(ReferencePart(n, None) for n in (*item.within, item.name))
            root.inside(Reference(item.at, name), 0).folder = file.parent
    elif file.suffix == ".mop":
        _wait(root, [p for p in sorted(file.parent.glob("*.mo")) if p.is_file() and p.stat().st_size <= reader.LARGEST])
    return root, classes


def _wait(root: Space, files: list[Path]) -> list[Path]:
    """Register files, to be parsed when one of their classes is looked up; return the files with a within clause."""
    others: list[Path] = []
    for file in files:
        text = reader.content_of(file)
        if _WITHIN.match(text):  # its classes belong to another package
            others.append(file)
            continue
        for name in dict.fromkeys(_CLASS.findall(text)):
            root.waiting.setdefault(name, []).append(file)
    return others


def _add(root: Space, path: Path) -> None:
    if path.is_dir():
        packages = [p for p in (path, *sorted(path.iterdir())) if (p / "package.mo").is_file()]
        files = [] if packages and packages[0] == path else sorted(path.glob("*.mo"))
        if not packages and not files:
            raise ModelicaError(f"the library folder {path} contains no package.mo and no .mo file")
        for folder in packages[:1] if packages and packages[0] == path else packages:
            name = folder.name.split(" ")[0]
            root.resolved[name] = _loaded(folder, root, name)
        parsed = [reader.read(file) for file in _wait(root, files)]
        for classes in sorted(parsed, key=lambda classes: len(classes[0].within) if classes else 0):
            _enter(root, classes)  # packages before the classes in them
    elif path.is_file():
        _enter(root, reader.read(path))
    else:
        raise ModelicaError(f"there is no library '{path}'")


def _enter(root: Space, classes: list[ClassText]) -> None:
    for text in classes:
        space = root
        for name in text.within:
            following = space.local_class(name)
            if following is None:
                following = space.resolved[name] = Space(ClassText(text.at, name, "package", scope=space.text), space)
            space = following
        text.scope = space.text if space.text.name else None
        before = space.text.classes.get(text.name)
        if before is not None and before is not text and before.at.source is text.at.source:
            raise ModelicaError(f"'{text.name}' is declared twice, first in line {before.at.line}", text.at)
        space.text.classes[text.name] = text
        space.resolved[text.name] = Space(text, space)


def _in_folder(folder: Path, name: str) -> Path | None:
    """Return the folder or file of a class of a package that is stored in a folder; None if there is none."""
    if not name.replace("_", "a").isalnum():
        return None
    if (folder / name / "package.mo").is_file():
        return folder / name
    return folder / f"{name}.mo" if (folder / f"{name}.mo").is_file() else None


def _loaded(path: Path, outer: Space, name: str) -> Space:
    file = path / "package.mo" if path.is_dir() else path
    classes = reader.read(file)
    text = next((c for c in classes if c.name == name), classes[0] if classes else None)
    if text is None:
        raise ModelicaError(f"{file} contains no class")
    text.scope = outer.text if outer.text.name else None
    return Space(text, outer, folder=path if path.is_dir() else None)
