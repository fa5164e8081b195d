"""Strict compilation of a generated folder and its comparison with Python."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path

import casadi as ca

from ..._version import __version__
from ...compiler.causal import CausalFunction
from ...compiler.toolchain import Toolchain, find
from ...results import Check, at_least, at_most
from ...results.disk import scratch
from ..generation import contents
from ..interface import Interface
from ..manifest import changed_entries, changed_files, interface_entry, lacks, parameters_hash, read, sha256
from ..real import GenerationError, real_of
from ..steps.function import StepFace, StepFunction, faces_of
from .comparison import CheckReport, check_report, compare, compare_steps


def check(
    folder: Path, functions: Mapping[str, CausalFunction | StepFunction], *, points: int = 1000, seed: int = 0
) -> CheckReport:
    """Compile a generated folder strictly and compare each function with Python at random points.

    Texts and manifest must equal those that this gtmodel writes, because random points do not test the constants of
    guards. Values must be equal bit for bit at points where both return GT_OK, and statuses at all points. Every
    function must have a solution at all points in its box of validity. In float the values must be near those of
    double. The folder is not changed. Without a compiler the report has not passed and says so.

    Args:
        folder: as `generate` wrote it.
        functions: the functions from which the folder was generated, under the same names.
        points: random points per function, near consistent points and far from them.
        seed: of the random points.

    Raises GenerationError if gtmodel did not generate the folder, or generated it from other names or shapes.

    >>> import tempfile
    >>> from pathlib import Path
    >>> class Square(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     area = gt.variable(unit="m2")
    ...     def equations(self):
    ...         yield self.area == self.x**2
    >>> functions = {"area": Square().causal(known="x", targets="area")}
    >>> with tempfile.TemporaryDirectory() as place:
    ...     made = gt.cgen.generate(functions, place, name="square")
    ...     report = gt.cgen.check(Path(place), functions, points=20)
    >>> report.passed
    True
    """
    folder = Path(folder)
    content = read(folder)
    if content is None:
        raise GenerationError(f"'{folder}' {lacks(folder)}; generate it first")
    box = {signal: rows for entry in content["functions"] for signal, rows in (entry["box"] or {}).items()}
    along = [entry["name"] for entry in content["functions"] if "along" in entry]
    faces, steps = faces_of(functions, content["name"], along, real_of(content["real"]), box)
    _check_same(folder, content, faces, steps)
    changed = changed_files(folder, content)
    parameters_different = int(content["parameters_sha256"] != parameters_hash(faces, steps))
    checks = {
        "files_changed": at_most(len(changed), 0, ", ".join(changed)),
        "parameters_different": at_most(parameters_different, 0, "hash of all names and values"),
    }
    # for another version of gtmodel or CasADi only the parameters can be compared
    same = (content["gtmodel"], content["casadi"]) == (__version__, ca.CasadiMeta.version())
    texts = contents(faces, content["name"], content["provenance"], steps) if same else {}
    differing = sorted(file for file, text in texts.items() if content["files"].get(file) != sha256(text))
    checks["files_not_as_generated"] = at_most(len(differing), 0, ", ".join(differing))
    entries = changed_entries(content, faces, same, steps)
    source = texts.get(f"gt_{content['name']}_body.c")
    entries += ["body_sha256"] * (source is not None and content["body_sha256"] != sha256(source))
    checks["manifest_not_as_generated"] = at_most(len(entries), 0, ", ".join(entries))
    if any(file not in content["files"] for file in differing):  # the other number type: calls would overrun buffers
        return check_report(checks, {}, {})
    tools = find()
    if isinstance(tools, str):
        return CheckReport(checks | {"compiler_found": at_least(0, 1, tools)}, tools, {}, {})
    rows: dict[str, int] = {}
    rows_ok: dict[str, int] = {}
    with scratch() as temporary:
        library, built = _build(tools, folder, content, temporary)
        checks |= built
        if library is not None:
            failures = int(library[f"gt_{content['name']}_selftest"]())
            checks["selftest_failures"] = at_most(failures, 0, "stored vectors compared by ==")
            for face in faces:
                compared, rows[face.key], rows_ok[face.key] = compare(library, face, points, seed)
                checks |= compared
            for step in steps:
                compared, rows[step.key], rows_ok[step.key] = compare_steps(library, step, points, seed)
                checks |= compared
    return check_report(checks, rows, rows_ok)


def _check_same(folder: Path, content: dict, faces: list[Interface], steps: list[StepFace]) -> None:
    entries = {entry["name"]: entry for entry in content["functions"]}
    stepping = {entry["name"] for entry in content.get("steps", [])}
    for name in stepping ^ {step.key for step in steps}:
        raise GenerationError(f"'{folder}' was generated from other step functions than '{name}'; generate it again")
    for face in faces:
        expected = interface_entry(face)
        actual = entries.pop(face.key, None)
        if actual is None or any(actual[key] != expected[key] for key in expected):
            raise GenerationError(f"'{folder}' was generated from another '{face.key}'; generate it again")
    if entries:
        raise GenerationError(f"'{folder}' also holds '{next(iter(entries))}'; give all functions of the folder")


def _build(
    tools: Toolchain, folder: Path, content: dict, temporary: Path
) -> tuple[ctypes.CDLL | None, dict[str, Check]]:
    """Return the shared library of all files, and checks of compiling, linking and symbols."""
    prefix = f"gt_{content['name']}"
    objects: dict[str, Path] = {}
    failed: dict[str, str] = {}
    for file in sorted(f for f in content["files"] if f.endswith(".c")):
        objects[file] = temporary / f"{file}.o"
        good, text = tools.compile(folder / file, objects[file])
        if not good:
            failed[file] = next((line for line in text.splitlines() if "error" in line), text.strip())
    checks = {"files_not_compiled": at_most(len(failed), 0, "; ".join(failed.values()) or "no warnings")}
    if failed:
        return None, checks
    # the program that runs the self-test prints; the functions themselves do not
    silent = [path for file, path in objects.items() if file != f"{prefix}_main.c"]
    good, foreign = tools.foreign_symbols(silent)
    checks["foreign_symbols"] = at_most(len(foreign) + (not good), 0, ", ".join(foreign) or "libm only")
    target = temporary / "library.so"
    good, text = tools.link_shared(silent, target)
    library = None
    if good:
        try:
            library = ctypes.CDLL(str(target))
        except OSError as error:
            text = str(error)
    checks["libraries_not_loaded"] = at_most(int(library is None), 0, "" if library else text.strip())
    return library, checks
