"""rumoca, a Modelica compiler in Rust, as the flattener in place of ours: its flat text is read by the same grammar."""

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
# what its flat text leaves out, by the names of its flat form in JSON; a form without these names is another's
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
    """The version that is installed. Raises ModelicaError without one."""
    try:
        import rumoca  # pyright: ignore[reportMissingImports]

        return importlib.metadata.version(rumoca.__name__)
    except ImportError:
        raise ModelicaError(
            "flattener = \"rumoca\" needs the package rumoca; pip install 'gtmodel[rumoca]' brings it (64 MB)"
        ) from None


def flat_file(
    path: str | os.PathLike[str], space: Space, library: Iterable[str | os.PathLike[str]], said: Mapping[str, Any]
) -> Path:
    """A file with the flat text that rumoca makes of a class, in the cache folder or else among temporary files.

    said: modifications by dotted name. Raises ModelicaError with rumoca's sentence where it fails, and for what its
    flat text would leave out.
    """
    name = space.name
    if space.text.restriction == "optimization":
        raise ModelicaError(f"rumoca knows no optimization, as {name}; leave flattener out", space.text.at)
    text = _marked(_asked(path, name, [str(p) for p in library], said))
    folder = trees.folder() or Path(tempfile.mkdtemp(prefix="gtmodel-"))
    file = folder / f"{identifier(name)}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.mo"
    with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".new", delete=False, encoding="utf-8") as new:
        new.write(f"// {name}, flattened by rumoca {version()}\n{text}")
    os.replace(new.name, file)
    trees.bound(folder)
    return file


def of_flat_file(file: Path, space: Space) -> Flattened:
    """The flat text of a class, where the class stands: functions that it calls are looked for from there."""
    try:
        (text,) = reader.read(file)
        text.restriction, text.name, text.within = "model", space.text.name, ()
        return flattened(Space(text, space.outer), NOTHING)
    except ModelicaError as error:
        sentence = f"{error.sentence}; of {file}, the flat text that rumoca {version()} wrote"
        raise ModelicaError(sentence, error.place) from None


def _asked(path: str | os.PathLike[str], name: str, library: list[str], said: Mapping[str, Any]) -> str:
    number = version()
    import rumoca  # pyright: ignore[reportMissingImports]

    source = Path(path).read_text(encoding="utf-8-sig", errors="replace")
    asked = name
    if said:
        source += f"\nmodel {_MODIFIED} extends {name}({_modification(said)}); end {_MODIFIED};\n"
        asked = _MODIFIED
    try:
        # alone in a folder: rumoca reads whatever lies beside a file
        with tempfile.TemporaryDirectory(prefix="gtmodel-rumoca-") as folder:
            file = Path(folder) / "model.mo"
            file.write_text(source, encoding="utf-8")
            session: Any = cast(Any, rumoca).Session(library or None)
            model = session.load(str(file), model=asked)
            form: dict[str, Any] = model.to_dict("flat")
            text: str = model.render("flat-modelica")
    except BaseException as error:
        # a panic of its Rust code is no Exception
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        lines = [line for line in str(error).splitlines() if line.strip()]
        reason = lines[0].replace(_MODIFIED, name) if lines else type(error).__name__
        raise ModelicaError(f"rumoca {number} did not flatten {name}: {reason}") from None
    _refuse_left_out(form, text, number, name)
    return text


def _refuse_left_out(form: dict[str, Any], text: str, number: str, name: str) -> None:
    """Its flat text says nothing of some parts of a class, and makes up numbers for others."""
    for key in [*_LEFT_OUT, *(k for keys in _SECTIONS.values() for k in keys), "variables"]:
        if key not in form:
            raise ModelicaError(f"rumoca {number} is not read: its flat form has no '{key}'; version 0.10.2 is")
        if key in _LEFT_OUT and form[key]:
            raise ModelicaError(f"{name} has {_LEFT_OUT[key]}, which the flat text of rumoca {number} leaves out")
    parts = re.split(r"^((?:initial )?equation)$", text, flags=re.MULTILINE)[1:]
    written = {head: len(re.findall(r";$", body, re.MULTILINE)) - 1 * (head == parts[-2])
               for head, body in zip(parts[::2], parts[1::2], strict=True)}  # fmt: skip
    for head, keys in _SECTIONS.items():
        if written.get(head, 0) != (count := sum(len(form[k]) for k in keys)):
            raise ModelicaError(
                f"rumoca {number} counts {count} {head}s of {name}, and its flat text has {written.get(head, 0)}"
            )
    for variable, item in cast("dict[str, dict[str, Any]]", form["variables"]).items():
        if "Parameter" not in item["variability"]:
            continue
        if item["fixed"] and not all(cast("list[bool]", item["fixed"])):
            raise ModelicaError(
                f"parameter '{variable}' of {name} has fixed = false, for which the flat text of rumoca {number} has 0"
            )
        start = (item["start"] or {}).get("Literal", {}).get("value")
        if item["binding"] is None and (item["start"] is None or start == {"Real": 0.0}):
            raise ModelicaError(f"parameter '{variable}' of {name} has no value; rumoca {number} would take 0")


def _modification(said: Mapping[str, Any]) -> str:
    """Values by dotted name as the modification of a class."""
    below: dict[str, dict[str, Any]] = {}
    own: dict[str, Any] = {}
    for name, value in said.items():
        first, dot, rest = name.partition(".")
        if dot:
            below.setdefault(first, {})[rest] = value
        else:
            own[first] = value
    parts = [f"{k} = {_value(v)}" for k, v in own.items()]
    return ", ".join(parts + [f"{k}({_modification(v)})" for k, v in below.items()])


def _value(value: Any) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "{" + ", ".join(map(_value, cast("list[Any]", value))) + "}"
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, (int, float)):
        raise ModelicaError(f"a parameter takes numbers; found {value!r}")
    return repr(value)


def _marked(text: str) -> str:
    """Names of components in quotation marks, as Modelica writes them, and literals as Modelica spells them."""
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
