"""From causal functions to a folder of C."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
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
RUNTIME = ("gt_compare.h", FLOATING, "gt_guard.h")
NEWTON = "gt_newton.h"
TRAJECTORY = "gt_traj.h"
STATUS = "gt_status.h"
_MAIN = "gt_model_main.c"
_IN_FLOAT = (
    "Numbers are float: within 1e-5 of the range of their signal of what double gives. A pivot means singular and a "
    "Newton residual is small at other limits than in double; manifest.json and the README name them."
)


@dataclass(frozen=True)
class Generated:
    """A generated folder: its files, the C names of its functions by their Python names, and operations by C name."""

    folder: Path
    name: str
    files: tuple[str, ...]
    functions: dict[str, str]
    operations: dict[str, int]

    @property
    def header(self) -> Path:
        """The header that a project includes."""
        return self.folder / f"gt_{self.name}.h"


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
) -> Generated:
    """Write a folder of C99 that compiles as delivered: `cc *.c -lm`. `study` also compiles it and compares it with
    Python.

    Args:
        functions: causal functions by the name they get in C, `gt_<name>_<function>`. Parameters are folded in. Step
            functions too, which become `gt_<name>_<function>_init` and `_step`.
        out: a new or empty folder, or one that gtmodel generated; or such a folder already held, see `held`.
        name: of the whole, part of every file name and symbol: several folders link into one program.
        overwrite: replace also files of ours that were changed by hand.
        provenance: what header and manifest say about the origin, e.g. robot, problem file and its hash.
        problem: the whole problem as JSON data, for the manifest: other tools rebuild the model from it.
        along: names of functions that get a second face, `gt_<name>_<function>_at`, along a sampled reference.
        real: "double" or "float", the numbers that C computes with.
        box: intervals [least, greatest] by name of an input such as "der(T)", one for each of its numbers or one for
            all; inside, every function whose inputs all have one must answer. It goes into the manifest.
        mark: (file name, text) -> the text to write, for code that failed a check and must say so.

    Raises GenerationError for a name that is no C identifier or is taken, and for a folder that is not ours;
    ModelError for a parameter without a value.

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
    if mark is not None:
        texts = {file: mark(file, text) for file, text in texts.items()}
    content = manifest(name, faces, provenance or {}, texts, hashes, problem or {}, steps)
    place = out.path if isinstance(out, Held) else Path(out)
    write(out if isinstance(out, Held) else place, texts, content, overwrite)
    operations = {e["symbol"]: e["operations"] for e in [*content["functions"], *content.get("steps", [])]}
    return Generated(place, name, (*texts, FILE), {f.key: f.symbol for f in [*faces, *steps]}, operations)


def contents(
    faces: list[Interface], name: str, provenance: Mapping[str, str], steps: Sequence[StepFace] = ()
) -> dict[str, str]:
    """Text of every file but the manifest, by file name."""
    own = f"gt_{name}"
    shared = (*RUNTIME, NEWTON, TRAJECTORY, *FILTER, STATUS)
    if f"{own}.h".lower() in (*shared, *map(file_name, shared)):
        raise GenerationError(f"'{name}' cannot name the generated code: {own}.h belongs to the runtime", "name")
    source, declarations = body(name, faces, [k for s in steps for k in s.function.kernels(s.symbol)])
    about = [f"gtmodel {__version__}, CasADi {ca.CasadiMeta.version()}."]
    about += [f"{key}: {value}" for key, value in provenance.items()]
    runtime = codegen_dir() / "runtime"
    newton = (NEWTON,) if any(face.newton for face in faces) else ()
    shared = (*RUNTIME, *newton, *((TRAJECTORY,) if any(face.along for face in faces) else ()))
    shared += tuple(dict.fromkeys(header for s in steps for header in s.function.runtime))
    in_float = [*faces, *steps][0].real is FLOAT
    main = (runtime / _MAIN).read_text(encoding="utf-8").replace("gt_model", own)
    if in_float:
        about.append(_IN_FLOAT)
        main = main.replace("About 1e-15", "About 1e-7")
    made = {
        f"{own}.h": header(name, faces, about, _hashes(faces, source, steps), steps),
        f"{own}.c": wrapper(name, faces, steps),
        f"{own}_body.h": declarations,
        f"{own}_body.c": source,
        f"{own}_selftest.c": selftest(name, faces, steps),
        f"{own}_main.c": main,
        **{file: (runtime / file).read_text(encoding="utf-8") for file in shared},
    }
    if in_float:  # gt_float.h says what both kinds of numbers must be
        made = {file_name(file): text if file == FLOATING else single(text) for file, text in made.items()}
    return {
        **made,
        STATUS: (runtime / STATUS).read_text(encoding="utf-8"),
        "Makefile": makefile(name),
        "README.md": readme(name, faces, steps),
    }


def _hashes(faces: list[Interface], source: str, steps: Sequence[StepFace]) -> dict[str, str]:
    return {"parameters_sha256": parameters_hash(faces, steps), "body_sha256": sha256(source)}
