"""From causal functions to a folder of C."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca

from .._files import codegen_dir
from .._version import __version__
from ..compiler.causal import CausalFunction
from ..results.folder import Held
from .body import body
from .folder import write
from .header import header
from .interface import Interface
from .manifest import FILE, manifest, parameters_hash, sha256
from .readme import makefile, readme
from .real import FILTER, FLOAT, GenerationError, file_name, real_of, single
from .steps.function import StepFace, StepFunction, faces_of
from .vectors import selftest
from .wrapper import wrapper

FLOATING = "gt_float.h"
SMALL = 5000  # lines of bodies that are compiled once more with their guards, in about a second
RUNTIME = ("gt_compare.h", FLOATING, "gt_guard.h")
NEWTON = "gt_newton.h"
TRAJECTORY = "gt_traj.h"
STATUS = "gt_status.h"
README = "README.md"
_MAIN = "gt_model_main.c"
_IN_FLOAT = (
    "Numbers are float: they differ from double by at most 1e-5 of the range of their signal. The limits of pivots and "
    "of Newton residuals differ from those of double; manifest.json and the README name them."
)


@dataclass(frozen=True)
class Generated:
    """A generated folder: its files, the C name of each function by Python name, the operation count by C name."""

    folder: Path
    name: str
    files: tuple[str, ...]
    functions: dict[str, str]
    operations: dict[str, int]

    @property
    def header(self) -> Path:
        """The header that a project includes."""
        return self.folder / f"gt_{self.name}.h"


@dataclass(frozen=True)
class Beside:
    """What a folder says beside its code: further files, a part of the README, and entries of the manifest."""

    files: Mapping[str, str] = field(default_factory=dict)
    readme: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


def generate(
    functions: Mapping[str, CausalFunction | StepFunction],
    out: Path | Held,
    *,
    name: str,
    overwrite: bool = False,
    provenance: Mapping[str, str] | None = None,
    problem: Mapping[str, Any] | None = None,
    along: Collection[str] = (),
    real: str = "double",
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
    mark: Callable[[str, str], str] | None = None,
    beside: Callable[[Mapping[str, str]], Beside] | None = None,
) -> Generated:
    """Write a folder of C99 code that `cc *.c -lm` compiles. `study` also compiles it and compares it with Python.

    Args:
        functions: by Python name. A causal function becomes `gt_<name>_<function>`, with the parameter values as
            constants; a step function becomes `gt_<name>_<function>_init` and `_step`.
        out: a new or empty folder, or one that gtmodel generated; or such a folder already locked, see `held`.
        name: part of every file name and symbol, so that several folders link into one program.
        overwrite: also replace generated files that somebody changed by hand.
        provenance: origin for header and manifest, e.g. robot, problem file and its hash.
        problem: the whole problem as JSON data for the manifest, from which other tools rebuild the model.
        along: names of functions that also get a variant along a sampled reference, `gt_<name>_<function>_at`.
        real: number type in C, "double" or "float".
        box: intervals [least, greatest] by name of an input such as "der(T)", one for each of its numbers or one for
            all. A function whose inputs all have intervals must have a solution everywhere inside; see manifest.json.
        mark: (file name, text) -> text to write; marks code that failed a check.
        beside: texts by file name -> what else the folder says, such as a certificate.

    Raises GenerationError if a name is not a C identifier or is already used, and if gtmodel did not write the folder;
    ModelError if a parameter has no value.

    >>> import tempfile
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> with tempfile.TemporaryDirectory() as place:
    ...     made = gt.cgen.generate({"fk": robot.causal(known="q", targets="T")}, place, name="l1")
    >>> made.functions
    {'fk': 'gt_l1_fk'}
    """
    faces, steps = faces_of(functions, name, along, real_of(real), box)
    texts = contents(faces, name, dict(provenance or {}), steps)
    hashes = _hashes(faces, texts[f"gt_{name}_body.c"], steps)
    more = Beside() if beside is None else beside(texts)
    texts |= {**more.files, README: texts[README] + more.readme}
    if mark is not None:
        texts = {file: mark(file, text) for file, text in texts.items()}
    content = manifest(name, faces, provenance or {}, texts, hashes, problem or {}, steps)
    content |= more.facts
    folder = out.path if isinstance(out, Held) else Path(out)
    write(out if isinstance(out, Held) else folder, texts, content, overwrite)
    operations = {e["symbol"]: e["operations"] for e in [*content["functions"], *content.get("steps", [])]}
    return Generated(folder, name, (*texts, FILE), {f.key: f.symbol for f in [*faces, *steps]}, operations)


def contents(
    faces: list[Interface], name: str, provenance: Mapping[str, str], steps: Sequence[StepFace] = ()
) -> dict[str, str]:
    """Return the text of every file except the manifest, by file name."""
    prefix = f"gt_{name}"
    shared = (*RUNTIME, NEWTON, TRAJECTORY, *FILTER, STATUS)
    if f"{prefix}.h".lower() in (*shared, *map(file_name, shared)):
        raise GenerationError(f"'{name}' cannot name the generated code: {prefix}.h belongs to the runtime", "name")
    source, declarations = body(name, faces, [k for s in steps for k in s.function.kernels(s.symbol)])
    about = [f"gtmodel {__version__}, CasADi {ca.CasadiMeta.version()}."]
    about += [f"{key}: {value}" for key, value in provenance.items()]
    runtime = codegen_dir() / "runtime"
    newton = (NEWTON,) if any(face.newton for face in faces) else ()
    shared = (*RUNTIME, *newton, *((TRAJECTORY,) if any(face.along for face in faces) else ()))
    shared += tuple(dict.fromkeys(header for s in steps for header in s.function.runtime))
    in_float = [*faces, *steps][0].real is FLOAT
    main = (runtime / _MAIN).read_text(encoding="utf-8").replace("gt_model", prefix)
    if in_float:
        about.append(_IN_FLOAT)
        main = main.replace("About 1e-15", "About 1e-7")
    texts = {
        f"{prefix}.h": header(name, faces, about, _hashes(faces, source, steps), steps),
        f"{prefix}.c": wrapper(name, faces, steps, inline=not steps and _small(faces, source)),
        f"{prefix}_body.h": declarations,
        f"{prefix}_body.c": source,
        f"{prefix}_selftest.c": selftest(name, faces, steps),
        f"{prefix}_main.c": main,
        **{file: (runtime / file).read_text(encoding="utf-8") for file in shared},
    }
    if in_float:  # gt_float.h checks double and float
        texts = {file_name(file): text if file == FLOATING else single(text) for file, text in texts.items()}
    return {
        **texts,
        STATUS: (runtime / STATUS).read_text(encoding="utf-8"),
        "Makefile": makefile(name),
        README: readme(name, faces, steps),
    }


def _small(faces: list[Interface], source: str) -> bool:
    """Whether the bodies are compiled with their guards: Newton's kernels and loops, as steps, gain but their size."""
    return source.count("\n") <= SMALL and not any(face.newton or face.loops is not None for face in faces)


def _hashes(faces: list[Interface], source: str, steps: Sequence[StepFace]) -> dict[str, str]:
    return {"parameters_sha256": parameters_hash(faces, steps), "body_sha256": sha256(source)}
