"""What goes into a unit beside its description: C of the model, and how values of the table reach it."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..cgen.text import comment, decimal
from .table import FmuTable

KINDS = {
    "time": "GT_FMU_TIME", "input": "GT_FMU_INPUT", "fixed": "GT_FMU_FIXED", "tunable": "GT_FMU_TUNABLE",
    "state": "GT_FMU_STATE", "derivative": "GT_FMU_COMPUTED", "output": "GT_FMU_COMPUTED",
}  # fmt: skip


_OF_PARAMETERS = re.compile(r"^#ifdef GT_FMU_PARAMETERS\n.*?^#endif /\* GT_FMU_PARAMETERS \*/\n", re.M | re.S)


@dataclass(frozen=True)
class FmuContent:
    """The table, files of C by name, and the functions that join them.

    memory: C declaration of the members of what is remembered. functions: C text of gt_fmu_begin, gt_fmu_compute,
    gt_fmu_sample and gt_fmu_along. header: the generated one to include. timed: the time enters the equations.
    """

    table: FmuTable
    files: Mapping[str, str]
    header: str
    memory: str
    functions: str
    timed: bool = False


def model_files(content: FmuContent, token: str) -> dict[str, str]:
    """gt_fmu_model.h and .c."""
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
    """C of the runtime for a unit whose model has no parameters that can be set."""
    return _OF_PARAMETERS.sub("", text)


def _limits(t: FmuTable) -> list[str]:
    """Least and greatest values; what has none takes every double."""
    if not t.parameters:
        return []
    largest = sys.float_info.max
    rows = [[max(t.variables[r].least, -largest), min(t.variables[r].most, largest)] for r in t.parameters]
    pairs = [f"{{{decimal(low)}, {decimal(high)}}}" for low, high in rows]
    text = ",\n    ".join(pairs)
    return [f"const double gt_fmu_limits[{len(rows)}][2] = {{\n    {text}\n}};\n"]


def _array(declarator: str, values: Sequence[str]) -> str:
    """A constant array, of at least one value."""
    values = list(values) or ["0"]
    rows = [", ".join(values[k : k + 6]) for k in range(0, len(values), 6)]
    return f"{declarator}[{len(values)}] = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _moved(references: Sequence[int], line: Callable[[int, int], str], *unused: str) -> str:
    if not references:
        return "".join(f"    (void){name};\n" for name in unused)
    return "".join(f"    {line(k, n)}\n" for k, n in enumerate(references))
