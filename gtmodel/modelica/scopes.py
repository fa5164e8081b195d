"""Which class a name means: packages, libraries on a path, imports, inherited classes, redeclarations."""

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
LANGUAGE = ("StateSelect", "AssertionLevel")  # types that every scope knows, encapsulated ones too
_BLANKS = r"(?:\s|//[^\n]*\n|/\*.*?\*/)"
# a file that begins with the name of the package it belongs to
_WITHIN = re.compile(rf"{_BLANKS}*within\b{_BLANKS}*\w", re.DOTALL)
# names behind the words that begin a class, wherever they stand: more than there are classes, never fewer
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
    """A class where it stands: its text, what is around it, and what redeclarations put in place of its classes."""

    text: ClassText
    outer: Space | None
    replaced: dict[str, Space] = field(default_factory=dict)
    made: dict[str, Space | None] = field(default_factory=dict)
    folder: Path | None = None
    package: Any = None  # its constants, once they are asked for
    # of the outermost: files not yet read, by names of classes in them
    waiting: dict[str, list[Path]] = field(default_factory=dict)
    _busy: set[str] = field(default_factory=set)
    said: Modifier = NOTHING  # what `m(Class(k = 3))` says about it
    limits: tuple[tuple[Modification, Space], ...] = ()  # modifications behind constrainedby of what it replaces
    limit: Space | None = None  # the interface of what it replaces
    instead: Space | None = None  # what a modification puts it in place of
    holder: Any = None  # the instance in which a redeclaration stands
    derived: Space | None = None  # of a class as it is inherited: the one that inherits, and may change, it
    original: Space | None = None  # of such a class: itself
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

    def own(self, name: str) -> Space | None:
        """A class that is declared in this one, or lies in its folder."""
        if name not in self.made:
            self._arrived(name)
        if name not in self.made:
            text = self.text.classes.get(name)
            inside = _in_folder(self.folder, name) if self.folder is not None else None
            known = text is not None or inside is not None
            if name in multibody.NAMES and (ours := multibody.own_text(self.name, name, known)) is not None:
                # examples of the library are read from its folder
                self.made[name] = Space(ours, self, folder=inside if inside is not None and inside.is_dir() else None)
            elif self.original is not None and (own := self.original.own(name)) is not None:
                self.made[name] = Space(own.text, self, folder=own.folder, original=own)
            elif text is not None:
                self.made[name] = Space(text, self)
            elif inside is not None:
                self.made[name] = _loaded(inside, self, name)
            else:
                self.made[name] = None
        return self.made[name]

    def _arrived(self, name: str) -> None:
        """Read the files of library folders in which a class of this name is written."""
        for file in self.waiting.pop(name, ()):
            for names in self.waiting.values():
                if file in names:
                    names.remove(file)
            _enter(self, [c for c in reader.read(file) if c.within or self.made.get(c.name) is None])

    def bases(self) -> Iterator[tuple[Space, Extends]]:
        """The classes that this one extends. Raises ModelicaError for a name that is none."""
        for element in self.text.elements:
            if isinstance(element, Extends) and element.base.parts[0].name not in PREDEFINED:
                yield self.base(element), element

    def base(self, extends: Extends) -> Space:
        """The class that an extends clause, or a short class, names."""
        first = extends.base.parts[0].name
        key = _key(extends)
        if key not in self.made:
            if key in self._busy:
                raise ModelicaError(f"{self.text.name} extends itself", extends.at)
            self._busy.add(key)
            try:
                if first == "ExternalObject":
                    raise ModelicaError(f"{self.name} is kept by another language, and is not taken", extends.at)
                around = self.outer if self.text.short and self.outer is not None else self
                space = around.find(extends.base, skip=extends if around is self else None)
                if space is self:
                    raise ModelicaError(f"{self.text.name} extends itself", extends.at)
                self.made[key] = space
            finally:
                self._busy.discard(key)
        result = self.made[key]
        if result is None:
            raise ModelicaError(f"there is no class '{first}' to extend", extends.at)
        return result

    @property
    def declared(self) -> frozenset[str]:
        """Names of its components, declared or inherited."""
        if self._declared is None:
            self._declared = frozenset()  # of a class that extends itself
            try:
                inherited = [base.declared for base, _ in self.bases()]
            except ModelicaError:
                self._declared = None
                raise
            own = [e.name for e in self.text.elements if isinstance(e, Component)]
            self._declared = frozenset(own).union(*inherited)
        return self._declared

    def view(self, extends: Extends) -> Space:
        """The class that an extends clause names, as it is inherited here: with what is redeclared and modified."""
        base = self.base(extends)
        written = extends.modification.arguments if extends.modification is not None else ()
        package = base.text.restriction == "package"
        changed = (
            self.derived is not None
            or self.text.redeclares
            or any(package or a.redeclared is not None for a in written)
        )
        if not changed:
            return base
        key = f"view {extends.at.line} {extends.at.column}"
        if key not in self.made:
            own = {"made": {}, "package": None, "_busy": set[str]()}
            self.made[key] = replace(base, **own, derived=self.derived or self, original=base)
        made = self.made[key]
        assert made is not None
        return made

    def _changed(self, extends: Extends, name: str, inherited: Space) -> Space:
        """An inherited class with what the extends clause says about it."""
        key = f"changed {name} {extends.at.line} {extends.at.column}"
        for argument in extends.modification.arguments if extends.modification is not None else ():
            if argument.name[0] != name or key in self.made:
                continue
            if isinstance(argument.redeclared, ClassText):
                new = Space(argument.redeclared, self, limits=inherited.bounds, limit=inherited.interface)
                new.instead = inherited if argument.redeclared is not inherited.text else None
                self.made[key] = new
            elif argument.redeclared is None:
                said = argument.modification
                if len(argument.name) > 1:
                    said = Modification(argument.at, [Argument(argument.at, argument.name[1:], said, frozenset())])
                own = Extends(argument.at, extends.base, said)
                text = ClassText(argument.at, name, inherited.text.restriction, elements=[own], short=True)
                made = self.made[key] = Space(text, self)
                made.made[_key(own)] = inherited
        return self.made.get(key) or inherited

    @property
    def bounds(self) -> tuple[tuple[Modification, Space], ...]:
        """Modifications behind constrainedby, which hold for whatever takes the place of this class."""
        written = self.text.constraint
        if written is not None and written.modification is not None and self.outer is not None:
            return ((written.modification, self.outer),)
        return self.limits

    @property
    def interface(self) -> Space:
        """The class of which whatever takes the place of this one is a subtype."""
        if self.text.constraint is not None and self.outer is not None:
            return self.outer.find(self.text.constraint.base)
        return self if self.limit is None else self.limit

    def member(self, name: str, skip: Extends | None = None) -> Space | None:
        """A class of this one, declared or inherited; where this one is inherited itself, as it is there."""
        own = self._member(name, skip)
        if own is None or self.derived is None or name in self.replaced:
            return own
        return self.derived._member(name) or own

    def _member(self, name: str, skip: Extends | None = None) -> Space | None:
        if name in self.replaced:
            return self.replaced[name]
        if (own := self.own(name)) is not None:
            return own
        if name in self._busy or skip is not None:  # what is extended is not looked for in what is inherited
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
        everything = [i for i in self.text.imports if not i.name]
        there = [c for i in everything if (c := self.root.absolute(i.reference).member(name)) is not None]
        if len({id(c.text) for c in there}) > 1:
            raise ModelicaError(f"'{name}' is imported from several packages", everything[0].at)
        return there[0] if there else None

    def lookup(self, name: str, skip: Extends | None = None) -> Space | None:
        """A class by the first word of its name, from here outwards."""
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
        """The class that a reference means. Raises ModelicaError where there is none."""
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
            # public files name a package from inside it where a class of its own, or one of those that are imported,
            # has the same name
            farther = self.outer.lookup(first) if self.outer is not None else None
            for other in (farther, self.root.own(first)):
                if other is not None and other is not space:
                    return other.inside(reference, 1)
            raise

    def _inherited_import(self, name: str) -> str:
        """The advice for a name that only a base class, or what is around that one, imports."""
        try:
            left = [base for base, _ in self.bases()]
            seen: list[Space] = []
            while left:
                around: Space | None = left.pop()
                if around in seen:
                    continue
                left += [base for base, _ in around.bases()]
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
            if following is None and space.name == "Modelica.Icons":  # pictures alone
                following = space.made[part.name] = Space(ClassText(space.text.at, part.name, "class"), space)
            if following is None:
                if refused := multibody.refusal(space.name, part.name):
                    raise ModelicaError(refused, reference.at)
                inside = space.name or "the files that were read"
                names = [*space.text.classes, *(space.made if space.outer is None else ())]
                hint = near(part.name, names)
                if not hint and space.text.at.source.path == str(_BUILT_IN):
                    hint = NOT_LOADED
                raise ModelicaError(f"there is no class '{part.name}' in {inside}{hint}", reference.at)
            space = following
        return space

    def names(self) -> list[str]:
        """Names of classes that can be written here."""
        result: list[str] = [*PREDEFINED]
        space: Space | None = self
        while space is not None:
            result += [*space.text.classes, *space.waiting]
            space = space.outer
        return result

    def with_replaced(self, replaced: dict[str, Space], instance: Any) -> Space:
        """This class, of one instance, with others in place of some of its own."""
        own = {**self.replaced, **replaced}
        return replace(self, replaced=own, made={}, _busy=set(), package=instance)

    def with_said(self, said: Modifier) -> Space:
        """This class with a modification from outside."""
        return replace(self, made={}, _busy=set(), said=merged(said, self.said))


def _key(extends: Extends) -> str:
    return f"extends {extends.base} {extends.at.line} {extends.at.column}"


def library(paths: Iterable[str | os.PathLike[str]]) -> Space:
    """The outermost scope: classes of the files and of the libraries' folders, later ones looked at first, and what is
    built in where no library has a Modelica of its own. Raises ModelicaError for a path that holds nothing."""
    at = Place(reader.Source("", ""), 1, 1)
    root = Space(ClassText(at, "", "package"), None)
    for path in paths:
        _add(root, Path(path))
    _enter(root, [c for c in reader.read(_BUILT_IN) if c.name not in root.waiting and root.own(c.name) is None])
    return root


def files_of(root: Space) -> list[Path]:
    """The files whose classes were read so far, but for what is built in."""
    files: set[Path] = set()
    seen: set[int] = set()
    left = [root]
    while left:
        space = left.pop()
        if id(space) not in seen:
            seen.add(id(space))
            left += [s for s in space.made.values() if s is not None]
            if path := space.text.at.source.path:
                files.add(Path(path))
    return sorted(files - {_BUILT_IN})


def of_text(text: str, paths: Iterable[str | os.PathLike[str]] = (), path: str = "") -> tuple[Space, list[ClassText]]:
    """As `library`, with the classes of a text in it, and these."""
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
    """Classes of files are read when their names are asked for; the files that belong to packages are given back."""
    others: list[Path] = []
    for file in files:
        text = reader.content_of(file)
        if _WITHIN.match(text):  # of another package, which then is to have it
            others.append(file)
            continue
        for name in dict.fromkeys(_CLASS.findall(text)):
            root.waiting.setdefault(name, []).append(file)
    return others


def _add(root: Space, path: Path) -> None:
    if path.is_dir():
        inside = [p for p in (path, *sorted(path.iterdir())) if (p / "package.mo").is_file()]
        files = [] if inside and inside[0] == path else sorted(path.glob("*.mo"))
        if not inside and not files:
            raise ModelicaError(f"the library folder {path} holds no package.mo and no .mo file")
        for folder in inside[:1] if inside and inside[0] == path else inside:
            name = folder.name.split(" ")[0]
            root.made[name] = _loaded(folder, root, name)
        read = [reader.read(file) for file in _wait(root, files)]
        for classes in sorted(read, key=lambda classes: len(classes[0].within) if classes else 0):
            _enter(root, classes)  # packages before what stands in them
    elif path.is_file():
        _enter(root, reader.read(path))
    else:
        raise ModelicaError(f"there is no library '{path}'")


def _enter(root: Space, classes: list[ClassText]) -> None:
    for text in classes:
        space = root
        for name in text.within:
            following = space.own(name)
            if following is None:
                following = space.made[name] = Space(ClassText(text.at, name, "package", scope=space.text), space)
            space = following
        text.scope = space.text if space.text.name else None
        before = space.text.classes.get(text.name)
        if before is not None and before is not text and before.at.source is text.at.source:
            raise ModelicaError(f"'{text.name}' is declared twice, first in line {before.at.line}", text.at)
        space.text.classes[text.name] = text
        space.made[text.name] = Space(text, space)


def _in_folder(folder: Path, name: str) -> Path | None:
    """Where a package in folders keeps a class of its own."""
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
        raise ModelicaError(f"{file} holds no class")
    text.scope = outer.text if outer.text.name else None
    return Space(text, outer, folder=path if path.is_dir() else None)
