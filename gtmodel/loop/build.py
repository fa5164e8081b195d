"""Build the C loop with a generated folder: write the adapter between the two and call the compiler."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._files import codegen_dir
from ..cgen import GenerationError
from ..cgen.manifest import changed_files, lacks, read, sha256
from ..compiler.toolchain import STANDARD, WARNINGS, exposed, find
from ..results.folder import unfinished
from .plant import Servo

ADAPTER = "gt_loop_model.c"
PROGRAM = "gt_loop"
STAMP = "gt_loop.sha256"  # hash of the program and of the files it was built from
# generated functions that a law may call: (input signals, output signals)
_FORWARD = (("q",), ("T",))
_CARTS = (("T", "der(T)"), ("q", "der(q)"))
_INVERSE_DYNAMICS = (("T", "der(T)", "der(T,2)"), ("tau",))
_JOINT_DYNAMICS = (("q", "der(q)", "der(q,2)"), ("tau",))


def manifest_of(folder: Path) -> dict[str, Any]:
    """Return the manifest of a generated folder. Raises GenerationError if the folder is incomplete or was edited."""
    content = read(folder)
    if content is None or unfinished(folder):
        raise GenerationError(
            f"'{folder}' {lacks(folder)}; make it with gtmodel codegen PROBLEM.toml -o {folder}", "folder"
        )
    changed = changed_files(folder, content)
    if changed:
        raise GenerationError(
            f"'{folder / changed[0]}' was changed since gtmodel wrote it; generate the folder again", "folder"
        )
    return content


def adapter(content: Mapping[str, Any], axes: int, joints: bool = False) -> str:
    """Return the text of gt_loop_model.c: the generated functions that laws call, under the names the loop uses."""
    forward = _function(content, *_FORWARD)
    dynamics = _function(content, *(_JOINT_DYNAMICS if joints else _INVERSE_DYNAMICS))
    carts = _function(content, *_CARTS)
    parts = [
        f"/* The functions of gt_{content['name']} that the laws of the loop call. Written by gtmodel. */\n",
        f'#include "gt_{content["name"]}.h"\n#include "gt_laws.h"\n\n#include <math.h>\n#include <stddef.h>\n\n',
    ]
    names = {"forward": "NULL", "inverse_dynamics": "NULL", "carts": "NULL"}
    plan = plan_of(content, axes)
    for name, function, arguments in (
        ("forward", forward, ("position_m", "tcp_m")),
        ("inverse_dynamics", dynamics, ("tcp_m", "tcp_m_s", "tcp_m_s2", "force_N")),
        ("carts", carts, ("tcp_m", "tcp_m_s", "position_m", "speed_m_s")),
    ):
        if function is not None:
            names[name] = f"gt_loop_model_{name}"
            parts.append(_call(names[name], function, arguments, content["real"]))
    if plan is not None:
        parts.append(_plan_text(plan, content["real"]))
    table = f"{axes}U, {', '.join(names.values())}, {int(joints)}, {'NULL' if plan is None else '&gt_loop_model_plan'}"
    parts.append(f"const gt_robot_model gt_loop_model = {{{table}}};\n")
    return "".join(parts)


def sources(content: Mapping[str, Any], axes: int, joints: bool = False) -> dict[str, str]:
    """Return the loop's files by name: runtime, loop and adapter. With the generated folder they make a program."""
    texts: dict[str, str] = {}
    for part in ("runtime", "loop"):
        for path in sorted((codegen_dir() / part).glob("*.[ch]")):
            if path.name != "gt_model_main.c" and path.name not in content["files"]:
                texts[path.name] = path.read_text(encoding="utf-8")
    return {**texts, ADAPTER: adapter(content, axes, joints)}


def build(folder: Path, place: Path, axes: int, joints: bool = False) -> Path:
    """Write the loop's files into `place` and compile them with the generated `folder`; returns the program's path.

    Args:
        folder: folder written by `gtmodel.cgen`, with the functions of a robot.
        place: folder for the loop's files and the program.
        axes: number of carts, or of joints of an arm if `joints`.

    A program built there from identical files is reused, unless it was changed since or another user can write to it.
    The compiler treats every warning as an error. Raises GenerationError if the folder was not generated or was edited,
    if there is no compiler, or if the code does not compile.

    >>> from pathlib import Path
    >>> gt.loop.build(Path("no_such_folder"), Path("loop"), axes=3)
    Traceback (most recent call last):
        ...
    gtmodel.cgen.real.GenerationError: ...
    """
    content = manifest_of(folder)
    tools = find()
    if isinstance(tools, str):
        raise GenerationError(tools)
    place.mkdir(parents=True, exist_ok=True)
    texts = sources(content, axes, joints)
    source_hash = sha256(json.dumps([texts, content["files"], tools.cc, STANDARD], sort_keys=True))
    stamp = place / STAMP
    program = place / PROGRAM
    for name, text in texts.items():
        (place / name).write_text(text, encoding="utf-8", newline="\n")
    if _stamped(program, stamp, source_hash):
        return program
    stamp.unlink(missing_ok=True)
    program.unlink(missing_ok=True)  # the compiler would keep the permissions of an existing file
    generated = [folder / f"gt_{content['name']}{part}.c" for part in ("", "_body")]
    handwritten = [place / name for name in texts if name.endswith(".c")]
    include = ("-I", folder, "-I", place)
    command = (tools.cc, *STANDARD, *WARNINGS, *include, *handwritten, *generated)
    good, text = tools.run(*command, "-o", program, "-lm", "-pthread")
    if not good:
        first = next((line for line in text.splitlines() if "error" in line), text.strip())
        raise GenerationError(f"the loop does not compile: {first}")
    stamp.write_text(f"{source_hash} {_hash(program)}", encoding="utf-8")
    return program


def built_before(earlier: Path, place: Path) -> None:
    """Copy the program of an earlier run and its stamp into `place`, unless another user could have written it.

    `build` then decides whether the copy can be reused; nobody else can change it in `place`.
    """
    with suppress(OSError):
        if not exposed(earlier / PROGRAM):
            for name in (PROGRAM, STAMP):
                shutil.copyfile(earlier / name, place / name)
            (place / PROGRAM).chmod(0o700)


def _stamped(program: Path, stamp: Path, source_hash: str) -> bool:
    """Return whether the program is unchanged since it was built from these files, and no other user can write it."""
    try:
        return stamp.read_text(encoding="utf-8") == f"{source_hash} {_hash(program)}" and not exposed(program)
    except (OSError, UnicodeDecodeError):
        return False


def _hash(program: Path) -> str:
    return hashlib.sha256(program.read_bytes()).hexdigest()


@dataclass(frozen=True)
class GeneratedPlan:
    """A predictive controller of a generated folder as the law of the loop uses it; see gt_robot_plan.

    goals: (signal, member, size) of the references of one stage. rows: stages with references of their own, and the
    end, or 1. stage_ms: length of a stage [ms]. limits: names, in the order of the bits that the law logs.
    bounds: lower and upper limits of references, None: no limit.
    servo: that the controller knows. radius: spectral radius of a cycle near the targets under it.
    """

    symbol: str
    reading: str
    before: str
    outputs: Mapping[str, str]
    goals: Sequence[tuple[str, str, int]]
    rows: int
    period_ms: int
    stage_ms: int
    delay: int
    limits: Sequence[str]
    max_iterations: int
    scalars: frozenset[str]
    servo: Servo
    radius: float
    bounds: Mapping[str, Sequence[Sequence[float | None]]]

    @property
    def columns(self) -> int:
        """Numbers of a row of references."""
        return sum(size for _, _, size in self.goals)


GOALS_MOST, AHEAD_MOST = 1024, 17  # of gt_robot_model.h


def plan_of(content: Mapping[str, Any], axes: int) -> GeneratedPlan | None:
    """Return the first predictive controller of a manifest that reads the axes and commands their servo."""
    for step in content.get("steps", ()):
        facts = step["facts"]
        readings = [m for m in step["inputs"] if not m["signal"].endswith((".goal", ".before"))]
        before = [m["member"] for m in step["inputs"] if m["signal"].endswith(".before")]
        if "stiffness" not in facts or len(readings) != 1 or readings[0]["count"] != axes:
            continue
        q = readings[0]["signal"]
        wanted = {"command_m": f"{q}.command", "position_m": q, "speed_m_s": f"der({q})", "force_N": f"{q[:-1]}tau"}
        given = {m["signal"]: m["member"] for m in step["outputs"] if m["count"] == axes}
        rows = facts["stages"] + 1 if facts["preview"] else 1
        goals = [(m["signal"].removesuffix(".goal"), m["member"], m["count"] // rows) for m in step["inputs"]
                 if m["signal"].endswith(".goal")]  # fmt: skip
        times = [1e3 * step["period"], facts["length_ms"]]
        whole = all(abs(t - round(t)) < 1e-9 * t for t in times[: 1 + facts["preview"]])
        fits = set(wanted.values()) <= set(given) and rows * sum(g[2] for g in goals) <= GOALS_MOST and goals
        if q.endswith("q") and fits and whole and facts["delay"] < AHEAD_MOST:
            return GeneratedPlan(
                step["symbol"], readings[0]["member"], before[0], {k: given[v] for k, v in wanted.items()}, goals, rows,
                round(times[0]), round(times[1]) if facts["preview"] else 0, facts["delay"], facts["limits"],
                facts["max_iterations"], frozenset(m["member"] for m in step["inputs"] if m["count"] == 1),
                Servo(tuple(facts["stiffness"]), tuple(facts["damping"])), facts["spectral_radius"],
                facts.get("bounds", {}),
            )  # fmt: skip
    return None


def _plan_text(plan: GeneratedPlan, real: str) -> str:
    """Return the C text of the table gt_loop_model_plan and of its functions."""
    symbol, narrow, wide = plan.symbol, *(("(float)", "(double)") if real == "float" else ("", ""))
    place, lines = 0, list[str]()
    for _, member, size in plan.goals:
        for k in range(size):
            at = "" if member in plan.scalars else f"[(row * {size}) + {k}]"
            lines.append(f"        in.{member}{at} = {narrow}goals[(row * {plan.columns}) + {place + k}];\n")
        place += size
    results = "".join(
        f"            cycle->{name}[k] = {wide}out.{member}[k];\n" for name, member in plan.outputs.items()
    )
    axes = "sizeof(in." + plan.reading + ") / sizeof(in." + plan.reading + "[0])"
    active = (
        f"        for (k = {len(plan.limits) - 1}; k >= 0; k--) {{\n"
        "            cycle->active = (2.0 * cycle->active) + ((out.active[k] > 0) ? 1.0 : 0.0);\n        }\n"
        if plan.limits
        else ""
    )
    return (
        "static gt_status gt_loop_model_begin(void *state, int sends_speed)\n{\n"
        f"    {symbol}_start start;\n\n    {symbol}_defaults(&start);\n"
        "    start.speeds = (sends_speed != 0) ? 1.0 : 0.0;\n"
        f"    return {symbol}_init(({symbol}_state *)state, &start);\n}}\n\n"
        "static gt_status gt_loop_model_step(void *state, const double *position_m, const double *before_m, "
        "const double *goals, gt_plan_cycle *cycle)\n{\n"
        f"    {symbol}_in in;\n    {symbol}_out out;\n    gt_status status;\n    int row;\n    int k;\n\n"
        f"    for (k = 0; k < (int)({axes}); k++) {{\n"
        f"        in.{plan.reading}[k] = (position_m != NULL) ? {narrow}position_m[k] : {narrow}NAN;\n"
        f"        in.{plan.before}[k] = {narrow}before_m[k];\n    }}\n"
        f"    for (row = 0; row < {plan.rows}; row++) {{\n{''.join(lines)}    }}\n"
        f"    status = {symbol}_step(({symbol}_state *)state, &in, &out);\n    if (status == GT_OK) {{\n"
        f"        for (k = 0; k < (int)({axes}); k++) {{\n{results}        }}\n"
        f"        cycle->cost = {wide}out.cost;\n        cycle->residual = {wide}out.residual;\n"
        f"        cycle->active = 0.0;\n{active}        cycle->iterations = out.iterations;\n"
        "        cycle->failed = out.failed;\n        cycle->lost = out.lost;\n    }\n    return status;\n}\n\n"
        f"static const gt_robot_plan gt_loop_model_plan = {{sizeof({symbol}_state), {plan.columns}U, {plan.rows}U, "
        f"{plan.period_ms}U, {plan.stage_ms}U, {plan.delay}U, gt_loop_model_begin, gt_loop_model_step}};\n\n"
    )


def _function(content: Mapping[str, Any], known: tuple[str, ...], targets: tuple[str, ...]) -> dict[str, Any] | None:
    for function in content["functions"]:
        if "state" in function:  # the caller keeps that state; laws cannot
            continue
        inputs = sorted(m["signal"] for m in function["inputs"])
        if inputs == sorted(known) and [m["signal"] for m in function["outputs"]] == list(targets):
            return {**function, "inputs": sorted(function["inputs"], key=lambda m: known.index(m["signal"]))}
    return None


def _call(name: str, function: Mapping[str, Any], arguments: tuple[str, ...], real: str) -> str:
    """Return the C text of a wrapper in double around a generated function in double or float."""
    symbol, count = function["symbol"], len(function["inputs"])
    inputs, outputs = arguments[:count], arguments[count:]
    parameters = ", ".join([*(f"const double *{a}" for a in inputs), *(f"double *{a}" for a in outputs)])
    lines = [f"static gt_status {name}({parameters})\n{{\n"]
    lines += [f"    {symbol}_in in;\n    {symbol}_out out;\n    gt_status status;\n    int k;\n\n"]
    narrow, wide = ("(float)", "(double)") if real == "float" else ("", "")
    for argument, member in zip(inputs, function["inputs"], strict=True):
        lines.append(_loop(f"in.{member['member']}[k] = {narrow}{argument}[k];", member["shape"][0], ""))
    lines.append(f"    status = {symbol}(&in, &out);\n    if (status == GT_OK) {{\n")
    for argument, result in zip(outputs, function["outputs"], strict=True):
        lines.append(_loop(f"{argument}[k] = {wide}out.{result['member']}[k];", result["shape"][0], "    "))
    return "".join([*lines, "    }\n    return status;\n}\n\n"])


def _loop(assignment: str, size: int, indent: str) -> str:
    return f"    {indent}for (k = 0; k < {size}; k++) {{\n        {indent}{assignment}\n    {indent}}}\n"
