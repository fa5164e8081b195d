"""README.md and Makefile of a generated folder."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from .._files import codegen_dir
from ..results.status import Status
from .interface import Interface
from .points import draw, evaluate
from .real import DOUBLE, decimal, single
from .steps.function import StepFace
from .wrapper import elements

_README = """\
# gt_{name}

C99 functions that gtmodel made from the equations of a model. They allocate no memory and keep nothing between calls
except in the `_state` structs that you own. They call only libm, and memcpy and memset if the compiler inserts them.

{functions}

## Compile

    cc *.c -lm && ./a.out        # runs the self-test
    make check                   # the same with warnings, and builds libgt_{name}.a

In a project, compile every `.c` file of this folder with your own and include `gt_{name}.h`. The `main` in
`gt_{name}_main.c` is weak and yields to yours; with a compiler that has no weak symbols define `GT_NO_MAIN`.

- Compile with `-ffp-contract=off`: then every result equals Python's bit for bit. The self-test compares with `==`.
- Never compile with `-ffast-math` or `-Ofast`: they remove the tests for NaN. With them the headers stop with `#error`.
- sin, cos, tanh and the like come from your libm, whose results may differ in the last bit.

## Call

{call}Members are in SI units and named with their unit; `gt_{name}.h` describes each. \
Outputs are written only with
`GT_OK`; with every other status they keep their values.

| status | code | meaning |
|---|---|---|
{statuses}

Compare the status with `GT_OK` before using a value. Several threads may call functions at once, on different structs.
{newton}
{numbers}

## Contract

{contract}
## Files

`gt_{name}.h` the header that you include · `gt_{name}.c` guards; it includes small bodies, to be faster ·
`gt_{name}_body.c` equations · `gt_{name}_selftest.c` stored results · `gt_{name}_main.c` runs the self-test ·
`gt_float.h`, `gt_guard.h`, `gt_compare.h`, `gt_status.h` shared by all generated folders ·
`manifest.json` functions, units, box, operations, parameters and hashes ·
`costs.json` bytes, stack and instructions on the machine where `--costs` last ran.

Do not edit these files: change the model and generate the folder again. `gtmodel codegen PROBLEM.toml -o DIR --check`
compares with Python.
"""

_CALL = """\
```c
#include <stdio.h>

#include "gt_{name}.h"

int main(void)
{{
    {symbol}_in in{initial};
    {symbol}_out out;
{state}    gt_status status;

{start}{fill}
    status = {symbol}({given}&in, &out);
    if (status != GT_OK) {{
        (void)printf("%s\\n", gt_status_sentence(status));
        return 1;
    }}
    (void)printf("{output} = %.17g\\n", out.{output});
    return 0;
}}
```

"""

_STEP = """\
A step function is called once in a cycle, here every {period} s, and computes from its inputs and its state.

```c
#include <stdio.h>

#include "gt_{name}.h"

int main(void)
{{
    {symbol}_start start;
    {symbol}_state state;
    {symbol}_in in = {{0}};
    {symbol}_out out;
    gt_status status;

    {symbol}_defaults(&start);
    status = {symbol}_init(&state, &start);
    if (status == GT_OK) {{
        status = {symbol}_step(&state, &in, &out); /* once in each cycle */
    }}
    if (status != GT_OK) {{
        (void)printf("%s\\n", gt_status_sentence(status));
        return 1;
    }}
    (void)printf("{output} = %.17g\\n", out.{output});
    return 0;
}}
```

"""

_NEWTON = """
A function without a closed form also takes a `_state`: its last solution, from which Newton's method makes four steps.
The state follows the robot from cycle to cycle. `_start` sets it to the home pose. For a robot in another pose, write
that pose into the state, or move the inputs there in small steps. `GT_NOT_CONVERGED`: the inputs moved too far in one
call, or a residual stayed above its limit. `GT_WRONG_BRANCH`: Newton's method found a solution in another assembly mode
than that of the home pose, because the state was in that mode or the inputs jumped towards their mirror image. The
solution in the state is kept in both cases. If the state itself is in another assembly mode, continue from a state of
the right one, such as that of `_start`, and move the inputs in small steps. The header names the branches that
distinguish the modes. Each caller needs its own state. `state.marks` holds how near its limits a call was, even one
that failed.
"""

_LIMITS = (
    "A pivot below {pivot:g} of its typical size means that the equations are singular; a branch is left below the "
    "same limit. Residuals of a Newton solution are at most {residual:g} of what one nominal of each unknown gives."
)
_NUMBERS = {
    "double": f"Numbers are double. {_LIMITS}",
    "float": "Numbers are float. Inside the box of manifest.json, or near consistent poses without a box, they "
    f"differ from double by at most 1e-5 of the signal's range. {_LIMITS}",
}
_EXAMPLE = re.compile(r"(?<=```c\n).*?(?=```)", re.S)

_MAKEFILE = """\
# make: the library; make check: the self-test; make clean
CC ?= cc
CFLAGS ?= -std=c99 -O2 -Wall -Wextra -Wconversion
GT_FLAGS = -ffp-contract=off
OBJECTS = gt_{name}.o gt_{name}_body.o gt_{name}_selftest.o

libgt_{name}.a: $(OBJECTS)
\t$(AR) rcs $@ $(OBJECTS)

check: gt_{name}_check
\t./gt_{name}_check

gt_{name}_check: gt_{name}_main.o libgt_{name}.a
\t$(CC) $(LDFLAGS) -o $@ gt_{name}_main.o libgt_{name}.a -lm

%.o: %.c $(wildcard *.h *_body.c)
\t$(CC) $(CFLAGS) $(GT_FLAGS) -c -o $@ $<

clean:
\trm -f gt_{name}_check libgt_{name}.a gt_{name}_main.o $(OBJECTS)

.PHONY: check clean
"""


def makefile(name: str) -> str:
    """Text of the Makefile."""
    return _MAKEFILE.format(name=name)


def readme(name: str, faces: list[Interface], steps: Sequence[StepFace] = ()) -> str:
    """Text of the README: how to compile, how to call, what the statuses mean."""
    real = [*faces, *steps][0].real
    text = _README.format(
        name=name,
        functions="\n".join([*map(_line, faces), *map(_step_line, steps)]),
        call="\n".join([*[_called(name, face) for face in faces[:1]], *[_stepped(name, s) for s in steps[:1]]]),
        newton=_NEWTON if any(f.newton for f in faces) else "",
        statuses="\n".join(f"| `{s.c_name}` | {int(s)} | {s.message} |" for s in Status),
        contract=(codegen_dir() / "contract.md").read_text(encoding="utf-8"),
        numbers=_NUMBERS[real.name].format(pivot=real.pivot, residual=real.residual),
    )
    return text if real is DOUBLE else _EXAMPLE.sub(lambda m: single(m[0]).replace("%.17g", "%.9g"), text)


def _called(name: str, face: Interface) -> str:
    """An example that calls a function."""
    first = face.outputs[0]
    return _CALL.format(
        name=name,
        symbol=face.symbol,
        initial="" if face.inputs else " = {0.0}",
        fill="\n".join(_fill(face)),
        state=f"    {face.symbol}_state state;\n" if face.newton else "",
        start=f"    {face.symbol}_start(&state);\n" if face.newton else "",
        given="&state, " if face.newton else "",
        output=f"{first.identifier}[0]" if first.is_array else first.identifier,
    )


def _stepped(name: str, face: StepFace) -> str:
    """An example that runs a step function."""
    first = next(m for m in face.function.outputs if not m.integer)
    output = first.elements("")[0]
    return _STEP.format(name=name, symbol=face.symbol, period=decimal(face.function.period), output=output)


def _step_line(face: StepFace) -> str:
    return f"- `{face.symbol}_init`, `{face.symbol}_step`: {face.function.title}"


def _line(face: Interface) -> str:
    outputs, inputs = (", ".join(m.signal for m in side) or "nothing" for side in (face.outputs, face.inputs))
    return f"- `{face.symbol}`: {outputs} from {inputs}"


def _fill(face: Interface) -> list[str]:
    """Assignments of an input for which the function has a solution."""
    row = iter(_example(face))
    lines = []
    for m in face.inputs:
        lines += [f"    {target} = {next(row)!r};" for target in elements(m, "in.")]
    return lines


def _example(face: Interface) -> list[float]:
    values = draw(face, 100, seed=1)
    short = np.array([[float(f"{x:.3g}") for x in row] for row in values.tolist()]).reshape(values.shape)
    if face.newton:
        short[:, face.input_size :] = [x for stage in face.newton for x in stage.home]
    _, status = evaluate(face, short)
    good = np.flatnonzero(status == Status.OK)
    return short[int(good[0]) if len(good) else 0].tolist()
