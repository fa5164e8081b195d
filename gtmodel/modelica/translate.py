"""Translation of a Modelica class to a Python class: the entry points for Python and the command line."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._near import near
from ..lang.model import Model
from ..results.disk import path_of
from .classes import identifier, text_of
from .constraints import Flattened
from .flatten import flattened
from .instances import NameScope
from .modifications import Given, Modifier
from .multibody.lean import lean, shown
from .names import split
from .python import Writer
from .scopes import Space, files_of, of_text
from .settled.units import fitted
from .syntax import Array, ClassText, Literal, ModelicaError, Place, Source

FLATTENERS = ("gtmodel", "rumoca")
SOLVED = ("optimization", "model", "class", "block")


@dataclass(frozen=True, eq=False)
class Translation:
    """A Modelica class translated to Python.

    Attributes:
        model: the class; call it for a model.
        optimization: whether it is an optimization.
        stop_time: of its `experiment` annotation [s]; None without one.
        warnings: sentences with file and line: inconsistent units, assertions that are not monitored.
        units: whether the units of the text are used.
        file, name: path of the file, and the dotted name of the class in it.
        flat_file: the flat text of another flattener; errors refer to its lines.
        libraries: the other files from which classes were read.
    """

    model: type[Model]
    optimization: bool
    stop_time: float | None
    warnings: tuple[str, ...]
    units: bool
    file: str
    name: str
    flat: Flattened
    flat_file: Path | None = None
    libraries: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Text:
    """A parsed file with its libraries."""

    root: Space
    classes: list[ClassText]
    path: str


def opened(path: str | os.PathLike[str], libraries: Iterable[str | os.PathLike[str]] = ()) -> Text:
    """Read a file and its libraries. Raises ModelicaError."""
    from .reader import content_of

    file = path_of(path)
    root, classes = of_text(content_of(path), libraries, str(file))
    return Text(root, classes, str(file))


def solvable(text: Text) -> dict[str, ClassText]:
    """Return the classes of the file that can be solved or simulated, by dotted name, in the order of the text."""
    result: dict[str, ClassText] = {}
    for top in text.classes:
        for item in top.walk():
            if item.restriction in SOLVED and "partial" not in item.prefixes:
                result[item.full_name] = item
    return result


def chosen(text: Text, name: str) -> tuple[str, Space]:
    """Return a class and its full name; the last part of a dotted name is enough if it is unique.

    Without a name: the only optimization, or else the only model. Raises ModelicaError, listing the candidates.
    """
    there = solvable(text)
    optimizations = [n for n, c in there.items() if c.restriction == "optimization"]
    file = Path(text.path).name
    if not name:
        candidates = optimizations or list(there)
        partial = next((c for top in text.classes for c in top.walk() if "partial" in c.prefixes), None)
        if not candidates and partial is not None:
            raise ModelicaError(f"{partial.name} is partial; name a class that extends it", partial.at)
        if len(candidates) != 1:
            listed = ", ".join(candidates) or "none"
            raise ModelicaError(
                f"{file} contains {len(candidates)} such classes; select one as {file}:Class, from {listed}"
            )
        name = candidates[0]
    everything = {item.full_name: item for top in text.classes for item in top.walk()}
    if name not in everything:
        tails = [n for n in everything if n.rpartition(".")[2] == name or n.endswith(f".{name}")]
        if len(tails) > 1:
            raise ModelicaError(f"{file} contains several classes '{name}': {', '.join(tails)}")
        if not tails:  # a class of a package that is stored in a folder
            inside = (name, *(f"{top.full_name}.{name}" for top in text.classes))
            tails = [n for n in inside if _at(text.root, n) is not None]
        if not tails:
            close = near(name, there) or f"; it has {', '.join(there) or 'none'}"
            raise ModelicaError(f"{file} contains no class '{name}'{close}")
        name = tails[0]
    space = _at(text.root, name)
    assert space is not None
    return name, space


def _at(root: Space, name: str) -> Space | None:
    """Return the class of a dotted name from the root, declared or stored in a folder; None if there is none."""
    space: Space | None = root
    for word in name.split("."):
        space = space.local_class(word) if space is not None else None
    return space


def _said(parameters: Mapping[str, Any]) -> Modifier:
    """Return values of Python or of a problem file as modifications from outside."""
    place = Place(Source("", ""), 1, 1)
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        *path, last = name.split(".")
        below = tree
        for word in path:
            below = below.setdefault(word, {})
            if not isinstance(below, dict):
                raise ModelicaError(f"parameters specify two things for '{'.'.join(path)}': a value, and '{name}'")
        if last in below:
            raise ModelicaError(f"parameters specify two things for '{name}': a value, and values of its components")
        below[last] = value

    def node(value: Any) -> Any:
        if hasattr(value, "tolist"):
            value = value.tolist()
        if isinstance(value, (list, tuple)):
            return Array(place, [node(v) for v in value])
        if not isinstance(value, (int, float, bool, str)):
            raise ModelicaError(f"a parameter must be a number, Boolean, string or array of these; found {value!r}")
        return Literal(place, value)

    def of(value: Any) -> Modifier:
        if isinstance(value, dict):
            return Modifier(inside={k: of(v) for k, v in value.items()})
        return Modifier(value=Given(node(value), NameScope(None, _EMPTY, None)))

    return Modifier(inside={k: of(v) for k, v in tree.items()})


_EMPTY: Any = None


def stop_time_of(text: ClassText) -> float | None:
    """Return StopTime of the experiment annotation of a class; None if it is missing or not a literal number."""
    for argument in text.annotation.arguments if text.annotation is not None else ():
        if argument.name == ("experiment",) and argument.modification is not None:
            for item in argument.modification.arguments:
                value = item.modification.value if item.modification is not None else None
                if item.name == ("StopTime",) and isinstance(value, Literal) and isinstance(value.value, (int, float)):
                    return float(value.value)
    return None


def translated(
    reference: str | os.PathLike[str],
    *,
    library: Iterable[str | os.PathLike[str]] = (),
    parameters: Mapping[str, Any] | None = None,
    flattener: str = "gtmodel",
) -> Translation:
    """Translate the class that `file.mop:Class` names; see `load`."""
    if flattener not in FLATTENERS:
        raise ModelicaError(f"there is no flattener '{flattener}'; expected {' or '.join(FLATTENERS)}")
    path, name = split(str(reference))
    library = list(library)
    text = opened(path, library)
    name, space = chosen(text, name)
    stop, written = stop_time_of(space.text), None
    if flattener == "rumoca":
        from .rumoca import flat_file, of_flat_file, version

        written = flat_file(path, space, library, parameters or {})
        flat = of_flat_file(written, space)
        flat.warnings.append(f"{name} was flattened by rumoca {version()}; errors refer to lines of {written.name}")
    else:
        flat = shown(flattened(space, _said(parameters or {})))
    cls, units, warnings = fitted(flat)
    cls._static = flat.static  # type: ignore[attr-defined]
    others = tuple(file for file in files_of(text.root) if file != Path(text.path))
    remarks = *flat.warnings, *warnings
    cls._notes = remarks
    return Translation(cls, flat.optimization, stop, remarks, units, text.path, name, flat, written, others)


def load(
    reference: str | os.PathLike[str],
    *,
    library: Iterable[str | os.PathLike[str]] = (),
    parameters: Mapping[str, Any] | None = None,
    flattener: str = "gtmodel",
) -> Any:
    """Translate a class of a Modelica or Optimica file to a gtmodel class, whose errors name the lines of the text.

    Args:
        reference: "file.mop:Class". The last part of a dotted name is enough if it is unique; the class can be
            omitted if the file contains one optimization, or no optimization and one model.
        library: files and folders with further classes, for example the folder of the Modelica Standard Library.
        parameters: values by dotted name, such as "tank.A"; they modify the class before it is flattened, so that
            structural parameters can be set.
        flattener: "rumoca" to flatten a model with that package instead of gtmodel's own flattener. Errors then name
            lines of its flat text, and the path of that text.

    Returns a subclass of gt.Optimization or gt.Model. Results have the names of the text, such as `tank[2].x`, counted
    from 1. Notes, such as units that do not match, are in `notes` of its solutions and studies. Raises ModelicaError, a
    ModelError, with file, line number and the line itself.

    >>> from pathlib import Path
    >>> import tempfile
    >>> text = '''
    ... optimization Rest(objectiveIntegrand = x^2 + u^2)
    ...   Real x(start = 1, fixed = true);
    ...   input Real u;
    ... equation
    ...   der(x) = u;
    ... end Rest;
    ... '''
    >>> file = Path(tempfile.mkdtemp()) / "rest.mop"
    >>> written = file.write_text(text)
    >>> Rest = gt.modelica.load(f"{file}:Rest")
    >>> round(gt.solve(Rest(), gt.Mesh(5)).objective, 4)  # tanh(1)
    0.7616
    """
    return translated(reference, library=library, parameters=parameters, flattener=flattener).model


def python_of(
    reference: str | os.PathLike[str],
    *,
    library: Iterable[str | os.PathLike[str]] = (),
    parameters: Mapping[str, Any] | None = None,
) -> str:
    """Return the flattened class that `file.mop:Class` names as the text of a Python module, to leave Modelica.

    Arguments and errors as for `load`. A name such as `tank[2].x` becomes tank_2_x.

    >>> from pathlib import Path
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "decay.mo"
    >>> written = file.write_text("model Decay Real x(start=1, fixed=true); equation der(x) = -x; end Decay;")
    >>> print(gt.modelica.python_of(str(file)).strip())
    import gtmodel as gt
    from gtmodel import der
    <BLANKLINE>
    <BLANKLINE>
    class Decay(gt.Model):
        \"\"\"Decay, from Modelica text.\"\"\"
        x = gt.variable(start=1.0, fixed=True)
    <BLANKLINE>
        def equations(self):
            yield (der(self.x) == -self.x)
    """
    item = translated(reference, library=library, parameters=parameters)
    return text_of(Writer(lean(item.flat), identifier, units=item.units).write())


def flat_of_text(
    reference: str | os.PathLike[str],
    *,
    library: Iterable[str | os.PathLike[str]] = (),
    parameters: Mapping[str, Any] | None = None,
) -> str:
    """Return the class that `file.mop:Class` names as flat Modelica text: scalars without components.

    Structural parameters are replaced by numbers. `load` gives the same class, with the same names, from this text.
    Arguments and errors as for `load`. A name such as `tank[2].x` becomes `'tank[2].x'`, which Modelica allows.

    >>> from pathlib import Path
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "decay.mo"
    >>> written = file.write_text("model D Real x; equation der(x) = -x; end D; model M D d(x(start=2)); end M;")
    >>> print(gt.modelica.flat_of_text(f"{file}:M").strip())
    model M
      Real 'd.x'(start = 2);
    equation
      der('d.x') = -'d.x';
    end M;
    """
    from .printed import flat_text

    return flat_text(translated(reference, library=library, parameters=parameters).flat)


def listing(path: str | os.PathLike[str], library: Iterable[str | os.PathLike[str]] = ()) -> dict[str, dict[str, str]]:
    """List the classes of a file that can be solved or simulated: name -> {"what": "optimization", "line": ..., ...}.

    Raises ModelicaError.

    >>> from pathlib import Path
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "decay.mo"
    >>> written = file.write_text('model Decay "of a state" Real x; equation der(x) = -x; end Decay;')
    >>> gt.modelica.listing(file)
    {'Decay': {'what': 'model', 'line': '1', 'description': 'of a state'}}
    """
    text = opened(path, library)
    return {
        name: {"what": item.restriction, "line": str(item.at.line), "description": item.description}
        for name, item in solvable(text).items()
    }
