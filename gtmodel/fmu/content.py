"""The content of an FMU: C of the model, values of the table, and the archive, a zip whose bytes depend on its content
only."""

from __future__ import annotations

import io
import math
import re
import sys
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from ..cgen.real import comment, decimal
from ..lang.units import BASE_SYMBOLS, UnitError, parse_unit
from ..results.read_bounds import XmlFault, swollen, walk_xml
from .table import FmuTable, FmuVariable

Attributes = Mapping[str, str | int | float | bool | None]
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
LOGS = {"logStatusDiscard": "there is no answer at these values", "logStatusError": "a call that is refused"}
_RADIANS = re.compile(r"(/\(?[^/]*?)?\brad(-?\d*)\b")
LICENSE = "MIT AND BSD-2-Clause"


def element(name: str, attributes: Attributes, inside: Sequence[str] = ()) -> str:
    """Return an XML element with its children, indented by two; attributes that are None are left out.

    >>> from gtmodel.fmu.content import element
    >>> element("Unit", {"name": "m", "offset": None}, [element("BaseUnit", {"m": 1})])
    '<Unit name="m">\\n  <BaseUnit m="1"/>\\n</Unit>\\n'
    """
    text = "".join(f' {key}="{_value(v)}"' for key, v in attributes.items() if v is not None)
    if not inside:
        return f"<{name}{text}/>\n"
    body = "".join(f"  {line}\n" for part in inside for line in part.splitlines())
    return f"<{name}{text}>\n{body}</{name}>\n"


def _value(value: str | int | float | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return escaped(repr(value) if isinstance(value, float) else str(value))


def escaped(text: str) -> str:
    """Escape a text for an attribute or a page."""
    for sign, word in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ('"', "&quot;")):
        text = text.replace(sign, word)
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def listed(numbers: Sequence[int]) -> str:
    """Return value references or indices, separated by blanks."""
    return " ".join(map(str, numbers))


def limits(v: FmuVariable) -> dict[str, float | None]:
    """Return the attributes of the least and the greatest value."""
    return {name: x if math.isfinite(x) else None for name, x in (("min", v.least), ("max", v.most))}


def unit_elements(table: FmuTable) -> list[str]:
    """Return one Unit element per unit in use, with exponents if these are integers; all numbers are in SI."""
    return [
        element("Unit", {"name": unit}, [element("BaseUnit", base)] if (base := base_unit(unit)) is not None else [])
        for unit in sorted({v.unit for v in table.numbers})
    ]


def base_unit(unit: str) -> dict[str, int] | None:
    """Return the nonzero exponents of FMI's base units; None if the FMU cannot be written with them.

    >>> from gtmodel.fmu.content import base_unit
    >>> base_unit("N.m/rad"), base_unit("m.rad-1")
    ({'kg': 1, 'm': 2, 's': -2, 'rad': -1}, {'m': 1, 'rad': -1})
    """
    try:
        parsed = parse_unit(unit)
    except UnitError:
        return None
    exponents: dict[str, Any] = dict(zip(BASE_SYMBOLS, parsed.dimension.exponents, strict=True))
    for below, power in _RADIANS.findall(unit):
        exponents["rad"] = exponents.get("rad", 0) + (-1 if below else 1) * int(power or 1)
    if not parsed.is_si or any(Fraction(e).denominator != 1 for e in exponents.values()):
        return None
    return {symbol: int(e) for symbol, e in exponents.items() if e}


def log_categories() -> str:
    """Return the element of the FMU's log categories."""
    inside = [element("Category", {"name": name, "description": about}) for name, about in LOGS.items()]
    return element("LogCategories", {}, inside)


DESCRIPTION = "modelDescription.xml"
FIRST = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold
PLAIN, PROGRAM = 0o100644, 0o100755
LEVEL = 9
MOST_DESCRIPTION = 1 << 26  # bytes: of 200,000 variables
# raised for a zip that is damaged, encrypted, or compressed with a method that Python lacks
_DAMAGED = (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error)


def archive(files: Mapping[str, bytes]) -> bytes:
    """Zip these files by path: sorted, with one time, fixed permissions and one compression.

    >>> from gtmodel.fmu.content import archive
    >>> archive({"b": b"2", "a": b"1"}) == archive({"a": b"1", "b": b"2"})
    True
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as z:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, FIRST)
            entry.create_system = 3  # Unix, on every machine
            entry.external_attr = (PROGRAM if name.startswith("binaries/") else PLAIN) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            z.writestr(entry, files[name], compresslevel=LEVEL)
    return buffer.getvalue()


class ArchiveFault(ValueError):
    """Reason why an archive is not unpacked; the sentence continues after the name of the archive."""


def unpack(path: Path, folder: Path) -> None:
    """Unpack the archive of an FMU into a folder.

    Raises ArchiveFault, before anything is written, if the file is not an archive or unpacks to far more than its own
    size, or if the description is too large, too deep or declares entities.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            if message := swollen(path, sum(entry.file_size for entry in packed.infolist())):
                raise ArchiveFault(f"{message}; pack it without unneeded files")
            if (size := packed.getinfo(DESCRIPTION).file_size) > MOST_DESCRIPTION:
                most = f"expected at most {MOST_DESCRIPTION / 1e6:.3g} MB"
                raise ArchiveFault(f"has a description of {size / 1e6:.4g} MB; {most}")
            walk_xml(packed.read(DESCRIPTION))
            packed.extractall(folder)
    except XmlFault as fault:
        raise ArchiveFault(f"has a description, {DESCRIPTION}, that {fault.sentence} (line {fault.line})") from fault
    except KeyError:
        raise ArchiveFault(f"contains no {DESCRIPTION}: it is not an FMU") from None
    except _DAMAGED as error:
        action = "unpacked" if path.is_file() else "read"
        reason = getattr(error, "strerror", None) or next(iter(str(error).splitlines()), type(error).__name__)
        raise ArchiveFault(f"cannot be {action}: {reason}") from error


def is_ours(path: Path) -> bool:
    """Return whether gtmodel wrote this archive."""
    try:
        with zipfile.ZipFile(path) as packed, packed.open(DESCRIPTION) as description:
            return b'generationTool="gtmodel ' in description.read(MOST_DESCRIPTION)
    except (*_DAMAGED, KeyError):
        return False


KINDS = {
    "time": "GT_FMU_TIME", "input": "GT_FMU_INPUT", "fixed": "GT_FMU_FIXED", "tunable": "GT_FMU_TUNABLE",
    "state": "GT_FMU_STATE", "derivative": "GT_FMU_COMPUTED", "output": "GT_FMU_COMPUTED",
}  # fmt: skip


_OF_PARAMETERS = re.compile(r"^#ifdef GT_FMU_PARAMETERS\n.*?^#endif /\* GT_FMU_PARAMETERS \*/\n", re.M | re.S)


@dataclass(frozen=True)
class FmuContent:
    """The table, C files by name, and the functions that join them.

    memory: C declarations of the members of the memory. functions: C text of gt_fmu_begin, gt_fmu_compute,
    gt_fmu_sample and gt_fmu_along. header: generated header to include. timed: the equations depend on time.
    """

    table: FmuTable
    files: Mapping[str, str]
    header: str
    memory: str
    functions: str
    timed: bool = False


def model_files(content: FmuContent, token: str) -> dict[str, str]:
    """Return gt_fmu_model.h and gt_fmu_model.c."""
    return {"gt_fmu_model.h": _header(content, token), "gt_fmu_model.c": _source(content)}


def _header(content: FmuContent, token: str) -> str:
    t = content.table
    n = len(t.numbers)
    status = next((k for k, v in enumerate(t.integers) if t.hold and v.name == "status"), 0)
    numbers = {
        "GT_FMU_REALS": n, "GT_FMU_INTEGERS": len(t.integers), "GT_FMU_STATES": len(t.states),
        "GT_FMU_REMEMBERS": int(t.remembers), "GT_FMU_SLOPES": int(t.derivatives), "GT_FMU_HOLD": int(t.hold),
        "GT_FMU_STATUS_PLACE": status, "GT_FMU_TIMED": int(content.timed),
    }  # fmt: skip
    kinds = {"GT_FMU_TIME": 0, "GT_FMU_INPUT": 1, "GT_FMU_FIXED": 2, "GT_FMU_TUNABLE": 3, "GT_FMU_STATE": 4,
             "GT_FMU_COMPUTED": 5}  # fmt: skip
    return "".join(
        [
            comment(
                [f"{t.name}: its variables and equations, for gt_fmu.h. Made from the model, as modelDescription.xml."]
            ),
            f'#ifndef GT_FMU_MODEL_H\n#define GT_FMU_MODEL_H\n\n#include "{content.header}"\n\n',
            f'#define GT_FMU_TOKEN "{token}"\n',
            *[f"#define {key} {value}\n" for key, value in numbers.items()],
            comment(["Longest step of the integrator inside, and period of samples [s]; 0: there are none."]),
            f"#define GT_FMU_STEP {decimal(t.step)}\n#define GT_FMU_PERIOD {decimal(t.period)}\n",
            comment(["What a variable is."]),
            *[f"#define {key} {value}U\n" for key, value in kinds.items()],
            f"\ntypedef struct gt_fmu_memory {{\n{content.memory}}} gt_fmu_memory;\n\n",
            comment(["By value reference: kind, start, and 1 for what has a derivative by others."]),
            f"extern const unsigned char gt_fmu_kinds[{n + len(t.integers)}];\n",
            f"extern const unsigned char gt_fmu_rate[{n}];\nextern const double gt_fmu_start[{n}];\n",
            f"extern const int gt_fmu_start_integers[{max(1, len(t.integers))}];\n",
            f"extern const double gt_fmu_nominals[{max(1, len(t.states))}];\n\n",
            comment(["Continuous states from and to the values, and their rates."]),
            "void gt_fmu_gather(const double *v, double *x);\nvoid gt_fmu_scatter(double *v, const double *x);\n"
            "void gt_fmu_rates(const double *v, double *dx);\n",
            *_about_parameters(t),
            comment(["What is remembered at the start, and outputs before the first sample."]),
            "gt_status gt_fmu_begin(gt_fmu_memory *memory, double *v);\n",
            comment(["What is computed; written with GT_OK only."]),
            "gt_status gt_fmu_compute(gt_fmu_memory *memory, double *v);\n",
            comment(["The same once in a period."]),
            "gt_status gt_fmu_sample(gt_fmu_memory *memory, double *v, int *n);\n",
            comment(["Derivatives of what is computed along a seed, or, where adjoint, against one."]),
            "gt_status gt_fmu_along(const gt_fmu_memory *memory, const double *v, const double *seed, double *made,\n"
            "                       int adjoint);\n\n#endif\n",
        ]
    )


def _source(content: FmuContent) -> str:
    t = content.table
    kinds = [KINDS[v.role] for v in t.variables]
    rates = {*t.rates, *t.computed}
    nominals = [decimal(t.variables[k].nominal) for k in t.states]
    return "".join(
        [
            comment([f"{t.name}: see gt_fmu_model.h."]),
            '#include "gt_fmu_model.h"\n\n#include "gt_guard.h"\n\n',
            _array("const unsigned char gt_fmu_kinds", kinds),
            _array("const unsigned char gt_fmu_rate", [f"{int(v.reference in rates)}U" for v in t.numbers]),
            _array("const double gt_fmu_start", [decimal(v.start or 0.0) for v in t.numbers]),
            _array("const int gt_fmu_start_integers", [str(v.start or 0) for v in t.integers]),
            _array("const double gt_fmu_nominals", nominals),
            *_limits(t),
            "\nvoid gt_fmu_gather(const double *v, double *x)\n{\n",
            _moved(t.states, lambda k, n: f"x[{k}] = v[{n}];", "v", "x"),
            "}\n\nvoid gt_fmu_scatter(double *v, const double *x)\n{\n",
            _moved(t.states, lambda k, n: f"v[{n}] = x[{k}];", "v", "x"),
            "}\n\nvoid gt_fmu_rates(const double *v, double *dx)\n{\n",
            _moved(t.rates, lambda k, n: f"dx[{k}] = v[{n}];", "v", "dx"),
            "}\n\n",
            content.functions,
        ]
    )


def _about_parameters(t: FmuTable) -> list[str]:
    if not t.parameters:
        return []
    return [
        comment(["Parameters of the model that can be set, with their limits; largest error of one part of a step."]),
        f"#define GT_FMU_PARAMETERS {len(t.parameters)}\n#define GT_FMU_FIRST_PARAMETER {t.parameters[0]}\n",
        f"#define GT_FMU_PART_ERROR {decimal(t.part_error)}\n",
        "extern const double gt_fmu_limits[GT_FMU_PARAMETERS][2];\n",
    ]


def without_parameters(text: str) -> str:
    """Return C of the runtime for a unit without settable model parameters."""
    return _OF_PARAMETERS.sub("", text)


def _limits(t: FmuTable) -> list[str]:
    """Return the array of least and greatest values; parameters without limits take every double."""
    if not t.parameters:
        return []
    largest = sys.float_info.max
    rows = [[max(t.variables[r].least, -largest), min(t.variables[r].most, largest)] for r in t.parameters]
    pairs = [f"{{{decimal(low)}, {decimal(high)}}}" for low, high in rows]
    text = ",\n    ".join(pairs)
    return [f"const double gt_fmu_limits[{len(rows)}][2] = {{\n    {text}\n}};\n"]


def _array(declarator: str, values: Sequence[str]) -> str:
    """Return a constant array of at least one value."""
    values = list(values) or ["0"]
    rows = [", ".join(values[k : k + 6]) for k in range(0, len(values), 6)]
    return f"{declarator}[{len(values)}] = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _moved(references: Sequence[int], line: Callable[[int, int], str], *unused: str) -> str:
    if not references:
        return "".join(f"    (void){name};\n" for name in unused)
    return "".join(f"    {line(k, n)}\n" for k, n in enumerate(references))
