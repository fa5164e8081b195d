"""manifest.json: contents and origin of a generated folder. The same input gives the same bytes."""

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
_ALSO = {"steps", "certificate"}  # only of folders with step functions, and of proved ones


def sha256(text: str) -> str:
    """Return the SHA-256 of a text in UTF-8."""
    return hashlib.sha256(text.encode()).hexdigest()


def changed_files(folder: Path, content: dict[str, Any]) -> list[str]:
    """Return the files of the manifest that were changed since they were written, or are missing."""
    changed = []
    for file, expected in content["files"].items():
        path = folder / file
        if not path.is_file() or sha256(path.read_text(encoding="utf-8", errors="replace")) != expected:
            changed.append(file)
    return changed


def changed_entries(
    content: dict[str, Any], faces: list[Interface], same: bool = True, steps: Sequence[StepFace] = ()
) -> list[str]:
    """Return the entries of a manifest that this gtmodel would write differently, as paths: `functions[0].limits.T`.

    Provenance, problem and hashes are not compared. Unless the folder is of the `same` versions of gtmodel and CasADi,
    only the models are compared, because their parameters do not depend on the versions.
    """
    expected = manifest(content["name"], faces, content["provenance"], {}, {}, {}, steps)
    compared = [key for key in expected if key not in ("provenance", "problem", "files")] if same else ["models"]
    # as JSON returns them: lists for tuples, keys as text
    expected = json.loads(json.dumps({key: expected[key] for key in compared}))
    return [path for key in compared for path in _differences(key, expected[key], content[key])]


def _differences(path: str, expected: Any, actual: Any) -> list[str]:
    """Return the paths at which two JSON values differ, in the order of the first value."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        keys = [*expected, *(key for key in actual if key not in expected)]
        return [p for key in keys for p in _differences(f"{path}.{key}", expected.get(key), actual.get(key))]
    if isinstance(expected, list) and isinstance(actual, list) and len(expected) == len(actual):
        pairs = enumerate(zip(expected, actual, strict=True))
        return [p for n, pair in pairs for p in _differences(f"{path}[{n}]", *pair)]
    same = type(expected) is type(actual) and expected == actual
    return [] if same or (_number(expected) and _number(actual) and expected == actual) else [path]


def _number(value: Any) -> bool:
    """True for an int or a float, but not for a bool."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def parameters_hash(faces: list[Interface], steps: Sequence[StepFace] = ()) -> str:
    """Return the hash of all parameter names and values, exact to the last bit."""
    named = {f.key: [[q.name, float(q.value).hex()] for q in f.function.flat.parameters] for f in faces}
    facts = {s.key: s.function.facts() for s in steps}
    return sha256(json.dumps({**named, **facts}, sort_keys=True))


def interface_entry(face: Interface) -> dict[str, Any]:
    """Return the manifest entry of a function: C names, inputs, outputs and state."""
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
    """Return the manifest as a dictionary; `files` are the texts of the other files, `problem` is JSON data."""
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
    """Return the number of arithmetic operations and libm calls in one evaluation of an SX function; a call of an
    external function counts as one."""
    passing = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN, ca.OP_PARAMETER)
    return sum(f.instruction_id(k) not in passing for k in range(f.n_instructions()))


def _box(face: Interface) -> dict[str, list[list[float]]] | None:
    """Return the intervals by signal, or None without a box for all inputs."""
    if face.box is None:
        return None
    rows = iter(face.box)
    return {m.signal: [list(next(rows)) for _ in range(m.size)] for m in face.inputs}


def read(folder: Path) -> dict[str, Any] | None:
    """Return the manifest of a folder; None if there is none, or if it has not the format of this gtmodel."""
    content = _content(folder)
    if content is None or content.get("format") != FORMAT or set(content) - _ALSO != _KEYS or not _readable(content):
        return None
    # reject paths to other folders, which somebody may have written into the manifest
    return content if all(Path(file).name == file for file in content["files"]) else None


def _content(folder: Path) -> dict[str, Any] | None:
    """Return the content of manifest.json; None if it is not a JSON dictionary."""
    try:
        content = json_of((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _readable(content: dict[str, Any]) -> bool:
    """True if the entries that readers use have the types that `manifest` writes; values are compared later."""
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
    """Return the values of a dictionary; [None] for anything else."""
    return list(value.values()) if isinstance(value, dict) else [None]


def lacks(folder: Path) -> str:
    """Return why `read` returned None, as the predicate of a sentence about the folder."""
    if unfinished(folder):
        return "is incomplete: gtmodel is writing there, or was interrupted while writing"
    if not (folder / FILE).exists():
        return f"was not written by gtmodel: it holds no {FILE}"
    content = _content(folder)
    if content is None or not str(content.get("format")).startswith(FORMAT.rstrip("0123456789")):
        return f"was not written by gtmodel: its {FILE} is of another origin"
    if not isinstance(content.get("gtmodel"), str) or (content["format"] == FORMAT and set(content) - _ALSO == _KEYS):
        return f"was not written by gtmodel in this state: somebody changed its {FILE}"
    return f"was generated by gtmodel {content['gtmodel']} in a format that gtmodel {__version__} does not read"


def step_entry(face: StepFace) -> dict[str, Any]:
    """Return the manifest entry of a step function: C names, period, members and origin."""
    f = face.function
    kernels = f.kernels(face.symbol)
    return {
        "name": face.key,
        "symbol": face.symbol,
        "title": f.title,
        "period": f.period,
        **{
            side: [{"member": m.identifier, "signal": m.name, "count": m.count, "unit": m.unit, "integer": m.integer}
                   for m in getattr(f, side)]
            for side in ("start", "inputs", "outputs", "state")
        },
        "operations": sum(operations(k) for k in kernels),
        "facts": f.facts(),
    }  # fmt: skip


def _members(members: Iterable[Member]) -> list[dict[str, Any]]:
    return [{"member": m.identifier, "signal": m.signal, "shape": list(m.shape), "unit": m.unit} for m in members]
