"""``gtmodel new``: a commented problem, model or robot file that works unchanged, from those shipped with gtmodel."""

from __future__ import annotations

import json
import re
import shlex
import textwrap
from collections.abc import Iterator, Sequence
from os.path import relpath
from pathlib import Path
from typing import Any

from gtmodel._files import problems_dir
from gtmodel._near import meant
from gtmodel._report import HELP, NO_REMARK, declared
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.files import parse, shipped_names
from gtmodel.problem_files.from_options import keys_of
from gtmodel.problem_files.registry import names, schema_of
from gtmodel.results.disk import write_whole
from gtmodel.results.read_bounds import toml_of

# where the first shipped problem of a kind is not the one to begin with: it is special, long, or needs a recording
_FIRST = {
    "calibration": "calibrate_l1", "compliance": "compliance_l1", "codegen": "l1_controller", "modes": "f1_modes",
    "identification": "inertia_l1", "kinematics": "planar_3rrr", "optimization": "van_der_pol",
    "calibration_plan": "plan_calibration_l1", "postures": "postures_ur_like", "robot_cameras": "plan_cameras_l1",
    "trajectory": "l1_min_time", "vibration": "vibration_step",
}  # fmt: skip
_MODEL, _MODEL_FILE = "stick_slip", "models/stick_slip.py"
_ROBOT_FILE = "models/six_axis_arm.toml"
WIDTH = 120
_QUOTED = re.compile(r"""["']([^"'\n]+)["']""")
_IMPORT = re.compile(r"^(?:from|import) (\w+)", re.M)


def example_of(kind: str) -> str:
    """Return the shipped problem with which a new one of this kind begins."""
    if kind in _FIRST:
        return _FIRST[kind]
    folder = problems_dir()
    return next(n for n in shipped_names() if parse((folder / f"{n}.toml").read_bytes()).get("kind") == kind)


def of_kind(what: str, kind: str | None) -> str:
    """Return the kind in place of the word problem. Raises InputError if it belongs to another word."""
    if kind is not None and what not in ("problem", kind):
        raise InputError(f"--kind belongs to the word problem, not to '{what}': gtmodel new problem --kind {kind}")
    return kind or what


def write(what: str, name: str, log: Path | None = None, place: Path | None = None) -> tuple[list[Path], str]:
    """Write the files into `place`, the working directory if it is None; return their paths and the next command.

    what: a kind, a shipped problem, "model" or "robot". log: recording of a calibration, in place of the shipped one.
    Raises InputError, also if a file is there already.
    """
    place = Path() if place is None else place
    stem = Path(name).name.removesuffix(".toml")
    target = place / Path(name).parent / f"{stem}.toml"
    if not stem.strip(".") or not stem.isprintable():
        raise InputError(f"'{name}' cannot be the name of a problem file")
    folder = problems_dir()
    if what == "robot":
        text = "\n".join(_without_schema((folder / _ROBOT_FILE).read_text(encoding="utf-8")))
        return _put({target: text.encode()}), _command("explain", target)
    kinds, shipped = names(), shipped_names()
    if what not in ("model", *kinds, *shipped):
        lists = "gtmodel schema shows the kinds, gtmodel list problems the problems"
        if what in ("problem", "kind"):
            raise InputError(f"name the kind in place of '{what}': gtmodel new calibration {name}; {lists}")
        raise InputError(f"there is no kind or problem '{what}'; {meant(what, [*kinds, *shipped], lists)}")
    source = _MODEL if what == "model" else what if what in shipped else example_of(what)
    text = (folder / f"{source}.toml").read_text(encoding="utf-8")
    kind = str(parse(text.encode())["kind"])
    files: dict[Path, bytes] = {}
    if log is not None:
        if kind != "calibration":
            raise InputError(f"--from fills the measurements of a calibration; '{what}' is of kind '{kind}'")
        text = _with_log(text, log, relpath(log, target.parent))
    for file in sorted(set(_needed(folder, text))):
        moved = f"{stem}.py" if what == "model" and file == _MODEL_FILE else file
        files[target.parent / moved] = (folder / file).read_bytes()
        text = text.replace(f'"{file}', f'"{moved}')
    head = [f"{HELP} From {source}, shipped with gtmodel. All keys: gtmodel schema {kind}"]
    content = "\n".join([*head, *_annotated(_without_schema(text), kind), *_further(text, kind)]) + "\n"
    words = ("codegen", target, "-o", f"{stem}-code") if kind == "codegen" else ("solve", target)
    return _put({target: content.encode(), **files}), _command(*words)


def _command(*words: object) -> str:
    return shlex.join(["gtmodel", *map(str, words)])


def _put(files: dict[Path, bytes]) -> list[Path]:
    """Write new files; data that is there already, unchanged, stays. Raises InputError if another file is there."""
    new = {path: data for path, data in files.items() if not (path.is_file() and path.read_bytes() == data)}
    for path in [next(iter(files)), *new]:
        if path.exists():
            raise InputError(f"{path} is there already; choose another name or another folder")
    try:
        for path, data in new.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, data, overwrite=False)
    except OSError as error:
        raise InputError(f"{error.filename} cannot be written: {error.strerror}") from error
    return list(new)


def _needed(folder: Path, text: str) -> Iterator[str]:
    """Shipped files that a text names in quotes, and those that they name or import in turn."""
    for word in _QUOTED.findall(text):
        path = folder / word.partition(":")[0]
        if not path.is_file() or path.suffix == ".html":
            continue
        yield path.relative_to(folder).as_posix()
        if path.suffix in (".py", ".toml"):
            inner = path.read_text(encoding="utf-8")
            beside = [f"{module}.py" for module in _IMPORT.findall(inner)]
            yield from _needed(folder, " ".join(f'"{path.parent.relative_to(folder)}/{word}"' for word in beside))
            yield from (f.relative_to(folder).as_posix() for w in _QUOTED.findall(inner)
                        if "." in w and (f := path.parent / w).is_file())  # fmt: skip


def _without_schema(text: str) -> list[str]:
    """Lines without the one for editors, whose path is another one here, and without calls of the shipped file."""
    return [s for s in text.rstrip().splitlines() if not NO_REMARK.match(s)]


def _annotated(lines: Sequence[str], kind: str) -> Iterator[str]:
    """Lines with the description of their key, if they have no comment and room for it."""
    known, table = {key.key: key for key in keys_of(schema_of(kind))}, ""
    for line in lines:
        if header := re.match(r"\[+([\w.]+)\](\])?", line):
            table = header[1] + ("[]" if header[2] else "")
        setting = re.match(r"(\w+) *=", line)
        key = declared(f"{table}.{setting[1]}".lstrip("."), known) if setting and "#" not in line else None
        if key is not None and key.description and _is_whole(line):
            longer = f"{line:<34}  # {key.description}"
            line = longer if len(longer) <= WIDTH else f"{_comment(key.description)}\n{line}"
        yield line


def _comment(text: str, indent: str = "") -> str:
    return textwrap.fill(text, WIDTH, initial_indent=f"{HELP} {indent}", subsequent_indent=f"{HELP}   {indent}",
                         break_long_words=False, break_on_hyphens=False)  # fmt: skip


def _is_whole(line: str) -> bool:
    try:
        return bool(toml_of(line))
    except ValueError:
        return False


def _further(text: str, kind: str) -> Iterator[str]:
    """Comments about the keys that stand outside tables and are not set."""
    data = parse(text.encode())
    rest = [key for key in keys_of(schema_of(kind)) if "." not in key.key and key.key not in data and key.description]
    if rest:
        yield f"\n{HELP} Further keys; they stand above the first [table]."
    for key in rest:
        default = f" = {key.default}" if key.default else ""
        unit = f" [{key.unit}]" if key.unit and key.unit not in key.description else ""
        yield _comment(f"{key.key}{default}: {key.description}{unit}", "  ")


_NAMED = {"q": r"q|cart|axis|joint|encoder|drive|motor", "T": r"t|tcp|tool|p|pos|position|xyz"}
_NUMBERED = re.compile(r"^(.*?)[ _.\[]?(\d+)\]?$")
_LETTERED = re.compile(r"^(.*?)[ _.]?([xyz])$", re.I)


def _with_log(text: str, log: Path, shown: str) -> str:
    """The text of a calibration with the file, columns and units that `inspect` sees in a log."""
    from gtmodel import _inspect

    try:
        columns = _inspect.run(str(log), {}, Context(name=log.stem)).outcome.values["streams"].values()
    except InputError as error:
        raise error.within(log.name) from error
    seen = [column for stream in columns for column in stream["columns"]]
    groups: dict[str, list[Any]] = {}
    for column in seen:
        # the unit at the end, as in axis1_mm, is no part of the name
        name = re.sub(rf"(?i)[ _.]\W?{re.escape(column['unit'] or '-')}\W?$", "", column["name"])
        match = _LETTERED.match(name) or _NUMBERED.match(name)
        groups.setdefault((match[1].lower() or "xyz") if match else name, []).append(column)
    listed = ", ".join(column["name"] for column in seen)
    for signal, pattern in _NAMED.items():
        fitting = [g for stem, g in groups.items() if re.fullmatch(pattern, stem) and len(g) > 1]
        if len(fitting) != 1:
            raise InputError(
                f"cannot tell which columns are {signal}; found {listed}; name them {signal}1, {signal}2, ... in the "
                "log, or leave --from out and write them into the file"
            )
        names_ = ", ".join(_text(column["name"]) for column in fitting[0])
        unit = fitting[0][0]["unit"]
        if not unit:
            raise InputError(f"{log.name} states no unit of {fitting[0][0]['name']}; write it behind the name, as [mm]")
        line = f'{signal} = {{ column = [{names_}], unit = "{unit}" }}  # unit: {fitting[0][0]["why"]}'
        text = re.sub(rf"^{signal} = \{{.*$", line.replace("\\", r"\\"), text, flags=re.M)
    for key, value in {"file": Path(shown).as_posix(), "title": f"Calibration from {log.name}"}.items():
        line = f"{key} = {_text(value)}"
        text = re.sub(rf"^{key} = .*$", line.replace("\\", r"\\"), text, flags=re.M)
    return text


def _text(value: str) -> str:
    """A text in quotes, as TOML writes it."""
    return json.dumps(value, ensure_ascii=False)
