"""manifest.json: what a generated folder holds and what it was made from. The same input gives the same bytes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca

from .._version import __version__
from ..results.folder import unfinished
from ..results.read_bounds import json_of
from ..results.status import Status
from .body import casadi_functions
from .interface import Interface, Member
from .steps.function import StepFace

FORMAT = "gtmodel-c-2"
FILE = "manifest.json"
_NAMES = """
    format name real gtmodel casadi parameters_sha256 body_sha256 provenance problem compile pivot_tolerance statuses
    functions models files
"""
_KEYS = set(_NAMES.split())
_ALSO = {"steps"}  # of folders that have some


def sha256(text: str) -> str:
    """Hash of a text in UTF-8."""
    return hashlib.sha256(text.encode()).hexdigest()


def changed_files(folder: Path, content: dict[str, Any]) -> list[str]:
    """Files of the manifest that are no longer as they were written, missing ones included."""
    changed = []
    for file, expected in content["files"].items():
        path = folder / file
        if not path.is_file() or sha256(path.read_text(encoding="utf-8", errors="replace")) != expected:
            changed.append(file)
    return changed


def changed_entries(
    content: dict[str, Any], faces: list[Interface], same: bool = True, steps: Sequence[StepFace] = ()
) -> list[str]:
    """Entries of a manifest that this gtmodel would write otherwise, as paths such as `functions[0].limits.T`.

    Not of provenance and problem, which functions do not tell, and not of hashes. Unless a folder is of the `same`
    version of gtmodel and CasADi only the models are compared: parameters are as the functions' whatever the version.
    """
    here = manifest(content["name"], faces, content["provenance"], {}, {}, {}, steps)
    compared = [key for key in here if key not in ("provenance", "problem", "files")] if same else ["models"]
    # as JSON gives them back: lists for tuples, keys as text
    here = json.loads(json.dumps({key: here[key] for key in compared}))
    return [path for key in compared for path in _differences(key, here[key], content[key])]


def _differences(path: str, here: Any, there: Any) -> list[str]:
    """Paths at which two JSON values differ, in the order of the first one."""
    if isinstance(here, dict) and isinstance(there, dict):
        keys = [*here, *(key for key in there if key not in here)]
        return [p for key in keys for p in _differences(f"{path}.{key}", here.get(key), there.get(key))]
    if isinstance(here, list) and isinstance(there, list) and len(here) == len(there):
        return [p for n, pair in enumerate(zip(here, there, strict=True)) for p in _differences(f"{path}[{n}]", *pair)]
    same = type(here) is type(there) and here == there
    return [] if same or (_number(here) and _number(there) and here == there) else [path]


def _number(value: Any) -> bool:
    """An int is the same number as a float, a truth value is not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def parameters_hash(faces: list[Interface], steps: Sequence[StepFace] = ()) -> str:
    """Hash of all parameter names and values, exact to the last bit."""
    named = {f.key: [[q.name, float(q.value).hex()] for q in f.function.flat.parameters] for f in faces}
    facts = {s.key: s.function.facts() for s in steps}
    return sha256(json.dumps({**named, **facts}, sort_keys=True))


def interface_entry(face: Interface) -> dict[str, Any]:
    """What a caller of one function must know."""
    entry = {
        "name": face.key,
        "symbol": face.symbol,
        "inputs": _members(face.inputs),
        "outputs": _members(face.outputs),
    }
    return {**entry, "state": _members(face.state)} if face.newton else entry


def manifest(
    name: str,
    faces: list[Interface],
    provenance: Mapping[str, str],
    files: Mapping[str, str],
    hashes: dict[str, str],
    problem: Mapping[str, Any],
    steps: Sequence[StepFace] = (),
) -> dict[str, Any]:
    """The manifest as a dictionary; `files` are the texts of the other files, `problem` the problem as JSON data."""
    real = [*faces, *steps][0].real
    models: list[dict[str, Any]] = []
    of_flat: dict[int, int] = {}
    functions = []
    for face in faces:
        flat = face.function.flat
        if id(flat) not in of_flat:
            of_flat[id(flat)] = len(models)
            named = [{"name": q.name, "value": q.value, "unit": q.unit or "?"} for q in flat.parameters]
            models.append({"title": flat.title, "parameters": named})
        margins = [{"kind": m.kind, "label": m.label, "scale": m.scale} for m in face.margins]
        offered: dict[str, Any] = {"along": f"{face.symbol}_at"} if face.along else {}
        offered["box"] = _box(face)
        offered["limits"] = {m.signal: limit for m, limit in zip(face.inputs, face.sizes.limits, strict=True)}
        offered["operations"] = sum(operations(g) for g in casadi_functions(face))
        if face.loops is not None:
            offered["operations"] += operations(face.loops.body.function)
        functions.append({**interface_entry(face), **offered, "model": of_flat[id(flat)], "margins": margins})
    stepping = {"steps": [step_entry(s) for s in steps]} if steps else {}
    return {
        "format": FORMAT,
        "name": name,
        "real": real.name,
        "gtmodel": __version__,
        "casadi": ca.CasadiMeta.version(),
        **hashes,
        "provenance": dict(provenance),
        "problem": dict(problem),
        "compile": {"bit_equal_with": ["-ffp-contract=off"], "never": ["-ffast-math", "-Ofast"], "link": ["-lm"]},
        "pivot_tolerance": real.pivot,
        "statuses": [{"code": int(s), "name": s.c_name, "sentence": s.message} for s in Status],
        "functions": functions,
        **stepping,
        "models": models,
        "files": {file: sha256(text) for file, text in sorted(files.items())},
    }


def operations(f: ca.Function) -> int:
    """Arithmetic operations and calls of libm in one evaluation of an SX function."""
    passing = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN, ca.OP_PARAMETER)
    return sum(f.instruction_id(k) not in passing for k in range(f.n_instructions()))


def _box(face: Interface) -> dict[str, list[list[float]]] | None:
    """Intervals by signal, or None where no box was given for all inputs."""
    if face.box is None:
        return None
    rows = iter(face.box)
    return {m.signal: [list(next(rows)) for _ in range(m.size)] for m in face.inputs}


def read(folder: Path) -> dict[str, Any] | None:
    """The manifest of a folder; None if it has none, or one that this form of gtmodel did not write."""
    content = _content(folder)
    if content is None or content.get("format") != FORMAT or set(content) - _ALSO != _KEYS or not _readable(content):
        return None
    # a manifest speaks of files of its own folder only, whatever somebody wrote into it
    return content if all(Path(file).name == file for file in content["files"]) else None


def _content(folder: Path) -> dict[str, Any] | None:
    """What the file of that name holds; None where it is no dictionary in JSON."""
    try:
        content = json_of((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _readable(content: dict[str, Any]) -> bool:
    """True where what readers go through has the form that `manifest` gives it; its values are compared later."""
    texts = [content["name"], content["gtmodel"], content["casadi"], *_texts(content["provenance"])]
    texts += _texts(content["files"])
    if not isinstance(content["functions"], list):
        return False
    for entry in content["functions"]:
        if not isinstance(entry, dict) or not {"name", "symbol", "inputs", "outputs", "box"} <= set(entry):
            return False
        texts.append(entry["name"])
        if not isinstance(entry["box"], dict | None):
            return False
    return all(isinstance(text, str) for text in texts)


def _texts(value: Any) -> list[Any]:
    """The values of a dictionary, [None] of anything else."""
    return list(value.values()) if isinstance(value, dict) else [None]


def lacks(folder: Path) -> str:
    """Why `read` found nothing, as the predicate of a sentence about the folder."""
    if unfinished(folder):
        return "is not whole: gtmodel is writing there, or broke off while it did"
    if not (folder / FILE).exists():
        return f"was not written by gtmodel, it holds no {FILE}"
    content = _content(folder)
    if content is None or not str(content.get("format")).startswith(FORMAT.rstrip("0123456789")):
        return f"was not written by gtmodel, its {FILE} is of another origin"
    if not isinstance(content.get("gtmodel"), str) or (content["format"] == FORMAT and set(content) - _ALSO == _KEYS):
        return f"was not written by gtmodel, somebody changed its {FILE}"
    return f"was generated by gtmodel {content['gtmodel']} in a form that this one, {__version__}, does not read"


def step_entry(face: StepFace) -> dict[str, Any]:
    """What a caller of a step function must know."""
    f = face.function
    kernels = f.kernels(face.symbol)
    return {
        "name": face.key,
        "symbol": face.symbol,
        "title": f.title,
        "period": f.period,
        **{
            what: [{"member": m.identifier, "signal": m.name, "count": m.count, "unit": m.unit, "integer": m.integer}
                   for m in getattr(f, what)]
            for what in ("start", "inputs", "outputs", "state")
        },
        "operations": sum(operations(k) for k in kernels),
        "facts": f.facts(),
    }  # fmt: skip


def _members(members: Iterable[Member]) -> list[dict[str, Any]]:
    return [{"member": m.identifier, "signal": m.signal, "shape": list(m.shape), "unit": m.unit} for m in members]
