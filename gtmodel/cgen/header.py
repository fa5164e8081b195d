"""gt_<name>.h: the typed interface that a project includes."""

from __future__ import annotations

from collections.abc import Sequence

from ..compiler.blocks import Root
from ..compiler.causal import CausalFunction
from .interface import Interface, Member
from .real import comment
from .steps.function import StepFace, declarations
from .wrapper import prototype, prototype_along

_CONVENTIONS = (
    "Every number is in SI units; a member's name ends in its unit. Matrices are stored row by row. A function "
    "writes its outputs only when it returns GT_OK; otherwise they keep their values. Functions keep nothing between "
    "calls except in structs that you own, and may run in several threads at once on different structs. Pointers must "
    "not be NULL."
)

_ALONG = (
    "The same along a sampled reference with the columns {columns}: linear between its rows, the last row after its "
    "end. Also returns GT_OUT_OF_RANGE if the reference has no rows, a step of zero or another number of columns, and "
    "GT_NOT_FINITE if a row is not finite."
)


def header(
    name: str, faces: list[Interface], about: list[str], hashes: dict[str, str], steps: Sequence[StepFace] = ()
) -> str:
    """Return the text of the public header. It begins with the lines `about`; `hashes` become string macros."""
    guard = f"GT_{name.upper()}_H"
    newton = '#include "gt_newton.h"\n' if any(face.newton for face in faces) else ""
    trajectory = '#include "gt_traj.h"\n' if any(face.along for face in faces) else ""
    parts = [
        comment([f"gt_{name}: functions made from the equations of a model.", "", *about, "", _CONVENTIONS]),
        f"#ifndef {guard}\n#define {guard}\n\n",
        newton,
        f'#include "gt_status.h"\n{trajectory}\n',
        '#ifdef __cplusplus\nextern "C" {\n#endif\n\n',
        comment(["Hashes of the parameters and of the body, for logs; manifest.json holds the same."]),
        *[f'#define GT_{name.upper()}_{key.upper()} "{value}"\n' for key, value in hashes.items()],
        "\n",
        *[_declarations(face) for face in faces],
        *[declarations(face) for face in steps],
        comment(["Compares every function by == with stored results of Python; returns how many vectors differ."]),
        f"int gt_{name}_selftest(void);\n\n",
        comment(["Largest difference found by the self-test; relative for stored numbers above one."]),
        f"double gt_{name}_selftest_difference(void);\n\n",
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
    ]
    return "".join(parts)


def _declarations(face: Interface) -> str:
    symbol = face.symbol
    inputs = ", ".join(m.signal for m in face.inputs) or "nothing"
    title = f"{face.key}: {', '.join(m.signal for m in face.outputs)} from {inputs}."
    about = [title, *conditions(face.function)]
    if face.inputs:
        sizes = [f"{m.signal} {limit:.4g}" for m, limit in zip(face.inputs, face.sizes.limits, strict=True)]
        about.append(
            f"- GT_OUT_OF_RANGE if the norm of the inputs, each divided by its limit, is above one: {', '.join(sizes)}"
        )
    state = []
    if face.newton:
        about += [
            "- Newton's method starts from the last solution in the state: GT_NOT_CONVERGED if the solution is too far "
            "from it or a residual stays above its limit",
            "- GT_SINGULAR if a pivot of Newton's method vanishes",
        ]
        state = [
            comment(["The last solution; the struct is yours. Only a call that returns GT_OK changes the solution."]),
            _struct(
                f"{symbol}_state",
                face.state,
                "    gt_newton_marks marks; /* distances from the limits, also of a call that failed */\n",
            ),
            comment(["Sets a state to the home pose. For a robot in another pose, write that pose into the state."]),
            f"void {symbol}_start({symbol}_state *state);\n\n",
        ]
    return "".join(
        [
            comment(about),
            _struct(f"{symbol}_in", face.inputs),
            _struct(f"{symbol}_out", face.outputs),
            *state,
            f"{prototype(face)};\n\n",
            comment([_ALONG.format(columns=", ".join(f"{m.signal} ({m.size})" for m in face.inputs))])
            + f"{prototype_along(face)};\n\n"
            if face.along
            else "",
        ]
    )


def conditions(function: CausalFunction) -> list[str]:
    """Lines on which of several solutions the function takes and on its statuses."""
    roots = [r for b in function.plan.blocks for r in b.roots]
    lines = [f"- of the two solutions for {r.label} the function takes the one {_chosen(r)}" for r in roots]
    kinds = [m.kind for m in function.margins]
    if "discriminant" in kinds:
        lines.append("- GT_OUT_OF_RANGE if no real solution exists")
    if "condition" in kinds:
        lines.append("- GT_OUT_OF_RANGE if inputs contradict each other, such as a quaternion not of unit length")
    if "limit" in kinds:
        lines.append("- GT_OUT_OF_RANGE if the solution exceeds the limits of a joint")
    if "solution" in kinds:
        lines.append("- GT_OUT_OF_RANGE if the solution for some of the inputs does not satisfy the others")
    sides = [m.label for m in function.margins if m.kind == "branch"]
    if sides:
        lines.append(
            f"- GT_WRONG_BRANCH if Newton's method led to a solution off these branches: {', '.join(sides)}; the "
            "state keeps its solution: continue from a state on these branches, such as that of _start, in small steps"
        )
    if "pivot" in kinds:
        lines.append("- GT_SINGULAR if a pivot vanishes; manifest.json names the pivots")
    return lines


def _chosen(root: Root) -> str:
    sign = f"with the {'+' if root.value > 0 else '-'} root"
    return f"{sign}: branch {root.settled_by}" if root.settled_by else sign


def _struct(name: str, members: tuple[Member, ...], last: str = "") -> str:
    rows = [f"    {m.declaration} {comment([_describe(m)]).rstrip()}\n" for m in members]
    rows = rows or ["    double unused; /* C knows no empty struct */\n"]
    return f"typedef struct {name} {{\n{''.join(rows)}{last}}} {name};\n\n"


def _describe(m: Member) -> str:
    unit = {"?": "unit not declared", "": "1"}.get(m.unit, m.unit)
    shape = f", {' x '.join(map(str, m.shape))} row by row" if len(m.shape) > 1 else ""
    text = f"{m.signal} [{unit}{shape}]"
    if m.description:
        text += f": {m.description}"
    return f"{text} ({m.where})" if m.where else text
