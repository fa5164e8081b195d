"""rumoca, a Modelica compiler in Rust, as an alternative flattener; the same parser reads its flat text."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from . import reader, trees
from .classes import identifier
from .constraints import Flattened
from .flatten import flattened
from .modifications import NOTHING
from .scopes import Space
from .syntax import ModelicaError

_MODIFIED = "GtmodelModified"
# sections that its flat text omits, by keys of its flat form in JSON; a form without these keys is another version's
_LEFT_OUT = {
    "when_chains": "when clauses", "algorithms": "algorithms", "initial_algorithms": "initial algorithms",
}  # fmt: skip
_SECTIONS = {"equation": ("equations", "assert_equations"),
             "initial equation": ("initial_equations", "initial_assert_equations")}  # fmt: skip
_SKIPPED = r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/|\'(?:\\.|[^\'\\])+\''
_INDEX = r"(?:\[[0-9, ]+\])?"
_DOTTED = re.compile(rf"{_SKIPPED}|[A-Za-z_]\w*{_INDEX}(?:\.[A-Za-z_]\w*{_INDEX})+", re.DOTALL)
_DECLARED = re.compile(
    rf"^  (?:[A-Za-z_][\w.]* )*[A-Za-z_][\w.]*{_INDEX} ([A-Za-z_][\w.\[\], ]*?)(?=\(| = | \"|;)", re.M
)


def version() -> str:
    """Return the installed version. Raises ModelicaError if rumoca is not installed."""
    try:
        import rumoca

        return importlib.metadata.version(rumoca.__name__)
    except ImportError:
        raise ModelicaError(
            "flattener = \"rumoca\" needs the package rumoca: pip install 'gtmodel[rumoca]' (64 MB)"
        ) from None


def flat_file(
    path: str | os.PathLike[str], space: Space, library: Iterable[str | os.PathLike[str]], parameters: Mapping[str, Any]
) -> Path:
    """Write rumoca's flat text of a class to a file in the cache folder, or in a temporary one, and return its path.

    parameters: values by dotted name. Raises ModelicaError with rumoca's message if it fails, and if the flat
    text would omit sections of the class.
    """
    name = space.name
    if space.text.restriction == "optimization":
        raise ModelicaError(
            f"{name} is an optimization, and rumoca knows no optimization; use the default flattener", space.text.at
        )
    text = _marked(_asked(path, name, [str(p) for p in library], parameters))
    folder = trees.folder() or Path(tempfile.mkdtemp(prefix="gtmodel-"))
    file = folder / f"{identifier(name)}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.mo"
    with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".new", delete=False, encoding="utf-8") as new:
        new.write(f"// {name}, flattened by rumoca {version()}\n{text}")
    os.replace(new.name, file)
    trees.bound(folder)
    return file


def of_flat_file(file: Path, space: Space) -> Flattened:
    """Flatten the flat text of a class in the scope of the class, in which its functions are looked up."""
    try:
        (text,) = reader.read(file)
        text.restriction, text.name, text.within = "model", space.text.name, ()
        return flattened(Space(text, space.outer), NOTHING)
    except ModelicaError as error:
        sentence = f"{error.sentence}; in {file}, the flat text written by rumoca {version()}"
        raise ModelicaError(sentence, error.place) from None


def _asked(path: str | os.PathLike[str], name: str, library: list[str], parameters: Mapping[str, Any]) -> str:
    number = version()
    import rumoca

    source = Path(path).read_text(encoding="utf-8-sig", errors="replace")
    target = name
    if parameters:
        source += f"\nmodel {_MODIFIED} extends {name}({_modification(parameters)}); end {_MODIFIED};\n"
        target = _MODIFIED
    try:
        # alone in a folder: rumoca reads all files beside it
        with tempfile.TemporaryDirectory(prefix="gtmodel-rumoca-") as folder:
            file = Path(folder) / "model.mo"
            file.write_text(source, encoding="utf-8")
            session: Any = cast(Any, rumoca).Session(library or None)
            model = session.load(str(file), model=target)
            form: dict[str, Any] = model.to_dict("flat")
            text: str = model.render("flat-modelica")
    except BaseException as error:
        # a panic of its Rust code is not an Exception
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        lines = [line for line in str(error).splitlines() if line.strip()]
        reason = lines[0].replace(_MODIFIED, name) if lines else type(error).__name__
        raise ModelicaError(f"rumoca {number} did not flatten {name}: {reason}") from None
    _check_complete(form, text, number, name)
    return text


def _check_complete(form: dict[str, Any], text: str, number: str, name: str) -> None:
    """Raises ModelicaError if the flat text omits sections of a class or invents values of parameters."""
    for key in [*_LEFT_OUT, *(k for keys in _SECTIONS.values() for k in keys), "variables"]:
        if key not in form:
            raise ModelicaError(
                f"rumoca {number} is not supported: its flat form has no '{key}'; install version 0.10.2"
            )
        if key in _LEFT_OUT and form[key]:
            raise ModelicaError(f"{name} has {_LEFT_OUT[key]}, which the flat text of rumoca {number} omits")
    parts = re.split(r"^((?:initial )?equation)$", text, flags=re.MULTILINE)[1:]
    equation_counts = {head: len(re.findall(r";$", body, re.MULTILINE)) - 1 * (head == parts[-2])
               for head, body in zip(parts[::2], parts[1::2], strict=True)}  # fmt: skip
    for head, keys in _SECTIONS.items():
        if equation_counts.get(head, 0) != (count := sum(len(form[k]) for k in keys)):
            raise ModelicaError(
                f"rumoca {number} reports {count} {head}s of {name}, "
                f"but its flat text has {equation_counts.get(head, 0)}"
            )
    for variable, item in cast("dict[str, dict[str, Any]]", form["variables"]).items():
        if "Parameter" not in item["variability"]:
            continue
        if item["fixed"] and not all(cast("list[bool]", item["fixed"])):
            raise ModelicaError(
                f"parameter '{variable}' of {name} has fixed = false; the flat text of rumoca {number} has 0 instead"
            )
        start = (item["start"] or {}).get("Literal", {}).get("value")
        if item["binding"] is None and (item["start"] is None or start == {"Real": 0.0}):
            raise ModelicaError(f"parameter '{variable}' of {name} has no value; rumoca {number} would use 0")


def _modification(parameters: Mapping[str, Any]) -> str:
    """Return values by dotted name as the text of a class modification."""
    nested: dict[str, dict[str, Any]] = {}
    direct: dict[str, Any] = {}
    for name, value in parameters.items():
        first, dot, rest = name.partition(".")
        if dot:
            nested.setdefault(first, {})[rest] = value
        else:
            direct[first] = value
    parts = [f"{k} = {_value(v)}" for k, v in direct.items()]
    return ", ".join(parts + [f"{k}({_modification(v)})" for k, v in nested.items()])


def _value(value: Any) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "{" + ", ".join(map(_value, cast("list[Any]", value))) + "}"
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, (int, float)):
        raise ModelicaError(f"a parameter must be a number or an array of numbers; found {value!r}")
    return repr(value)


def _marked(text: str) -> str:
    """Return flat text with dotted names as quoted identifiers, and StateSelect literals in Modelica's spelling."""
    head = re.split(r"^(?:initial )?equation$", text, maxsplit=1, flags=re.MULTILINE)[0]
    names = {n.strip() for n in _DECLARED.findall(head) if "." in n}

    def one(match: re.Match[str]) -> str:
        word = match[0]
        if word.startswith(("'", '"', "/")):
            return word
        if word.startswith("StateSelect."):
            return word.lower().replace("stateselect", "StateSelect")
        parts = word.split(".")
        for count in range(len(parts), 1, -1):
            known = ".".join(parts[:count])
            rest = "".join(f".{p}" for p in parts[count:])
            if known in names:
                return f"'{known}'{rest}"
            bare, bracket, index = known.rpartition("[")
            if bracket and bare in names:
                return f"'{bare}'[{index}{rest}"
        return word

    return _DOTTED.sub(one, text)
