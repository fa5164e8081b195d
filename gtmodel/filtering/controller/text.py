"""C code of a filter: its tables, init and step, based on gt_filter.h."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...cgen.interface import macro
from ...cgen.real import Real, comment, decimal
from ...cgen.steps.function import step_prototype
from ..transition import TAYLOR
from .plan import FilterPlan, Kernel, SensorPlan, TransitionPlan
from .sparse import EntryMatrix, EntryProduct
from .twin import limits

if TYPE_CHECKING:
    from .controller_filter import ControllerFilter

PER_LINE = 16


def text(controller: ControllerFilter, symbol: str, real: Real) -> str:
    """Return the C code of a filter."""
    plan = controller.plan
    return "".join(
        [
            *[_no_scratch(symbol, kernel) for kernel in plan.kernels],
            _motion(plan, plan.motion, symbol) if plan.motion is not None else "",
            *[_sensor(sensor, symbol) for sensor in plan.sensors],
            _filter(plan, symbol, real, controller.pivot_of(real)),
            _init(controller, symbol),
            _step(controller, symbol),
        ]
    )


def _no_scratch(symbol: str, kernel: Kernel) -> str:
    m = macro(f"{symbol}_{kernel.name}")
    return f'#if ({m}_SZ_IW > 0) || ({m}_SZ_W > 0)\n#error "the kernels of {symbol} must not need scratch"\n#endif\n'


def _ints(name: str, values: Sequence[int]) -> str:
    return _array(f"static const int {name}", [str(int(v)) for v in values] or ["0"])


def _reals(name: str, values: Sequence[float]) -> str:
    return _array(f"static const double {name}", [decimal(float(v)) for v in values] or ["0.0"])


def _array(declarator: str, numbers: list[str]) -> str:
    lines = [", ".join(numbers[k : k + PER_LINE]) for k in range(0, len(numbers), PER_LINE)]
    body = ",\n    ".join(lines)
    return f"{declarator}[{len(numbers)}] = {{\n    {body}\n}};\n"


def _matrix(name: str, matrix: EntryMatrix, columns: Sequence[int] | None = None) -> tuple[str, str]:
    """Tables of a matrix, and its initialiser."""
    tables = _ints(f"{name}_start", matrix.start)
    tables += _ints(f"{name}_column", matrix.columns if columns is None else columns)
    head = f"{matrix.shape[0]}, {len(matrix.places)}, {name}_start, {name}_column"
    if len(matrix.changing) == len(matrix.places) and matrix.expressions is not None:
        return tables, f"{{{head}, 0, {len(matrix.changing)}, 0}}"
    tables += _reals(f"{name}_value", matrix.value.tolist()) + _ints(f"{name}_place", matrix.changing.tolist())
    return tables, f"{{{head}, {name}_value, {len(matrix.changing)}, {name}_place}}"


def _product(name: str, product: EntryProduct) -> tuple[str, str]:
    tables = _ints(f"{name}_start", product.start) + _ints(f"{name}_left", product.left.tolist())
    tables += _ints(f"{name}_right", product.right.tolist())
    return tables, f"{{{len(product.start) - 1}, {name}_start, {name}_left, {name}_right}}"


def _motion(plan: FilterPlan, m: TransitionPlan, symbol: str) -> str:
    responses = {place: k for k, place in enumerate(m.responses)}
    matrices = [
        _matrix(f"{symbol}_jacobian", m.jacobian, [j * m.width for j in m.jacobian.columns]),
        _matrix(f"{symbol}_frames", m.frames, m.frame_places),
        _matrix(f"{symbol}_arrival", m.arrival, [j * m.width for j in m.arrival.columns]),
        _matrix(f"{symbol}_drift", m.drift),
        _matrix(f"{symbol}_drive", m.drive, [responses[p] for p in m.drive.places]),
    ]
    products = [
        _product(f"{symbol}_response", m.response),
        _product(f"{symbol}_spread", m.spread),
    ]
    names = ("fixed_path", "fixed_response", "fixed_total", "weights", "powers")
    kernels = [_kernel(symbol, k) for k in (m.rates, m.frame, m.noise)]
    tables = "".join(table for table, _ in [*matrices, *products])
    tables += "".join(_reals(f"{symbol}_{name}", getattr(m, name).ravel().tolist()) for name in names)
    tables += _ints(f"{symbol}_picked", m.picked)
    tables += _ints(f"{symbol}_power", [k * len(m.responses) for k in range(1, TAYLOR + 1)])
    paths = f"{m.width}, {_given(m)}, {_turning(plan)}, {m.fixed_path[0].size}, {symbol}_fixed_path, {symbol}_picked"
    fixed = [paths, f"{m.fixed_response.shape[1]}, {symbol}_fixed_response"]
    rest = [*fixed, *[f"{symbol}_{name}" for name in (*names[2:], "power")]]
    inner = ",\n    ".join([*kernels, *[head for _, head in [*matrices, *products]], *rest])
    return f"{tables}static const gt_filter_motion {symbol}_motion = {{\n    {inner}\n}};\n"


def _kernel(symbol: str, kernel: Kernel | None) -> str:
    return "0" if kernel is None else f"{symbol}_{kernel.name}"


def _sensor(sensor: SensorPlan, symbol: str) -> str:
    name = f"{symbol}_{sensor.kernel.name}"
    return _matrix(f"{name}_jacobian", sensor.jacobian)[0] + _reals(f"{name}_variance", sensor.variance.tolist())


def _filter(plan: FilterPlan, symbol: str, real: Real, pivot: float) -> str:
    rows = []
    text = ""
    for sensor in plan.sensors:
        name = f"{symbol}_{sensor.kernel.name}"
        text += _reals(f"{name}_limit", limits(sensor, real).tolist())
        matrix = _matrix(f"{name}_jacobian", sensor.jacobian)[1]
        rows.append(
            f"    {{{sensor.size}, {sensor.first}, {sensor.delay}, {int(sensor.quaternion)}, {sensor.stale}, "
            f"{sensor.closed}, {decimal(sensor.gate)}, {name},\n     {matrix},\n     {name}_variance, {name}_limit}}"
        )
    inner = ",\n".join(rows)
    text += f"static const gt_filter_sensor {symbol}_sensors[{len(rows)}] = {{\n{inner}\n}};\n"
    tables, transition = _matrix(f"{symbol}_transition", plan.transition)
    more, noise = _matrix(f"{symbol}_noises", plan.noise)
    more += _reals(f"{symbol}_same", [*plan.same, 0.0][: plan.stride])
    more += _ints(f"{symbol}_reached", plan.reached)
    more += _ints(f"{symbol}_back", [-k * plan.stride for k in range(plan.errors)])
    text += tables + more + _ints(f"{symbol}_turned", [n for pair in plan.turned for n in pair])
    text += _ints(f"{symbol}_error_of", plan.error_of)
    motion = "0" if plan.motion is None else f"&{symbol}_motion"
    sizes = [plan.size, plan.errors, plan.stride, plan.inputs, plan.numbers, len(plan.sensors), plan.depth, plan.parts]
    unit = plan.unit if plan.motion is not None else None
    kernels = [_kernel(symbol, plan.given), motion, _kernel(symbol, unit)]
    return (
        f"{text}static const gt_filter {symbol}_filter = {{\n    {', '.join(map(str, sizes))}, {decimal(plan.step)},\n"
        f"    {', '.join(kernels)}, {len(plan.turned)}, {symbol}_turned, {symbol}_error_of,\n    {transition},\n"
        f"    {noise},\n    {symbol}_same, {symbol}_reached, {symbol}_back, {symbol}_sensors, {decimal(pivot)}\n}};\n\n"
    )


def _init(controller: ControllerFilter, symbol: str) -> str:
    plan, space = controller.plan, controller.system.space
    mean, deviation = controller.mean_members, controller.deviation_members
    known = controller.known_members
    fill = []
    for m, (_, at, _) in zip(mean, space.places(), strict=True):
        fill.append(f"    gt_copy(&mean[{at.start}], {m.address('start->')}, {m.count});\n")
    for m, (_, _, along) in zip(deviation, space.places(), strict=True):
        fill.append(f"    gt_copy(&deviation[{along.start}], {m.address('start->')}, {m.count});\n")
    first = 0
    for m in known:
        fill.append(f"    gt_copy(&u[{first}], {m.address('start->')}, {m.count});\n")
        first += m.count
    none = "" if known else "    u[0] = 0.0;\n"
    return (
        f"GT_FILTER_ONCE gt_status {symbol}_init({symbol}_state *state, const {symbol}_start *start)\n{{\n"
        f"    static const {symbol}_state empty = {{0}};\n    {symbol}_state next = empty;\n"
        f"    gt_filter_memory memory;\n    double mean[{plan.size}];\n    double deviation[{plan.errors}];\n"
        f"    double u[{max(1, plan.inputs)}];\n    gt_status status;\n\n"
        f"{''.join(fill)}{none}{_remembered(plan)}"
        f"    status = gt_filter_begin(&{symbol}_filter, &memory, mean, deviation, u);\n"
        "    if (status == GT_OK) {\n        *state = next;\n    }\n"
        "    return status;\n}\n\n"
    )


def _remembered(plan: FilterPlan) -> str:
    """C statements that point the memory into the state `next`."""
    known = plan.inputs > 0
    return (
        "    memory.belief.time = &next.time_s;\n    memory.belief.mean = next.mean;\n"
        "    memory.belief.factor = next.factor;\n    memory.belief.diagonal = next.diagonal;\n"
        "    memory.belief.closed = next.closed;\n"
        f"    memory.before = {'next.before' if known else 'u'};\n"
        f"    memory.inputs = {'next.inputs' if known else 'u'};\n"
        "    memory.readings = next.readings;\n    memory.present = next.present;\n    memory.place = &next.place;\n"
        "    memory.begun = &next.begun;\n    memory.age = next.age;\n"
    )


def _step(controller: ControllerFilter, symbol: str) -> str:
    plan, space = controller.plan, controller.system.space
    n, stride, sensors = plan.errors, plan.stride, len(plan.sensors)
    members = controller.sensor_members
    fill, first = [], 0
    for m in controller.known_members:
        fill.append(f"    gt_copy(&u[{first}], {m.address('in->')}, {m.count});\n")
        first += m.count
    for k, (sensor, (value, flag, _, _)) in enumerate(zip(plan.sensors, members, strict=True)):
        fill.append(f"    gt_copy(&z[{sensor.first}], {value.address('in->')}, {value.count});\n")
        fill.append(f"    flags[{k}] = in->{flag.identifier};\n")
    out = []
    for m, (_, at, _) in zip(controller.mean_members, space.places(), strict=True):
        out.append(f"    gt_copy({m.address('out->')}, &now.mean[{at.start}], {m.count});\n")
    out.append(f"    for (k = 0; k < {n}; k++) {{\n        deviation[k] = sqrt(variance[k]);\n    }}\n")
    for m, (_, _, along) in zip(controller.deviation_members, space.places(), strict=True):
        out.append(f"    gt_copy({m.address('out->')}, &deviation[{along.start}], {m.count});\n")
    for k, (_, _, gated, age) in enumerate(members):
        out.append(f"    out->{gated.identifier} = gated[{k}];\n    out->{age.identifier} = next.age[{k}];\n")
    ahead = plan.depth > 0
    memory = [
        f"    double ahead_mean[{plan.size}];\n    double ahead_factor[{n * stride}];\n"
        f"    double ahead_diagonal[{n}];\n    double ahead_time;\n    int ahead_closed[{2 * sensors}];\n"
        if ahead
        else ""
    ]
    now = (
        "    now.time = &ahead_time;\n    now.mean = ahead_mean;\n    now.factor = ahead_factor;\n"
        "    now.diagonal = ahead_diagonal;\n    now.closed = ahead_closed;\n"
        if ahead
        else "    now = memory.belief;\n"
    )
    levers = sum(len(s.jacobian.places) for s in plan.sensors)
    none = "" if plan.inputs else "    u[0] = 0.0;\n"
    square = max(n * stride, _responses(plan))
    sizes = {
        "square": square, "other": square, "vectors": 2 * stride, "error": stride, "variance": stride,
        "residual": plan.numbers, "lever": levers, "noise": len(plan.noise.places),
        "transition": len(plan.transition.places), "values": _values(plan),
    }  # fmt: skip
    arrays = "".join(f"    double {name}[{size}];\n" for name, size in sizes.items())
    work = "".join(f"    work.{name} = {name};\n" for name in sizes)
    return (
        comment(["All working memory is on the stack; the state is copied and written back at the end."])
        + f"GT_FILTER_OFTEN {step_prototype(symbol)}\n{{\n"
        f"    {symbol}_state next = *state;\n    gt_filter_memory memory;\n    gt_filter_belief now;\n"
        f"    gt_filter_outcome outcome;\n    gt_filter_work work;\n{''.join(memory)}{arrays}"
        f"    double u[{max(1, plan.inputs)}];\n    double z[{plan.numbers}];\n    double nis;\n"
        f"    int flags[{sensors}];\n    int gated[{sensors}];\n"
        f"    double deviation[{n}];\n    int count;\n    int k;\n    gt_status status;\n\n"
        f"{''.join(fill)}{none}{work}"
        f"{_remembered(plan)}"
        "    outcome.nis = &nis;\n    outcome.count = &count;\n    outcome.gated = gated;\n"
        f"{now}    status = gt_filter_cycle(&{symbol}_filter, &memory, u, z, flags, &now, &outcome, &work);\n"
        "    if (status == GT_OK) {\n"
        + "".join(f"    {line}\n" for part in out for line in part.splitlines())
        + "        out->nis = nis;\n        out->count = count;\n        *state = next;\n    }\n"
        "    return status;\n}\n\n"
    )


def _responses(plan: FilterPlan) -> int:
    """Largest number of values for the responses to noise and their products."""
    return 0 if plan.motion is None else (TAYLOR + 1) * len(plan.motion.responses) + 2 * len(plan.noise.places) + 4


def _given(m: TransitionPlan) -> int:
    """Largest number of matrix entries needed at the same time."""
    first = max(len(m.jacobian.places), len(m.frames.places), len(m.arrival.places))
    return max(first, len(m.drift.places) + len(m.drive.places))


def _turning(plan: FilterPlan) -> int:
    """Largest number of changing entries of E and F."""
    return max(12 * len(plan.turned), len(plan.transition.changing))


def _values(plan: FilterPlan) -> int:
    """Largest number of values in `work.values`."""
    first = plan.size + 2 * plan.inputs
    if plan.motion is None:
        return first + max(1, len(plan.transition.changing))
    m = plan.motion
    more = 3 * max(plan.size, 4) + plan.inputs + _given(m) + _turning(plan)
    return first + more + 4 * m.moving * m.width + m.fixed_path[0].size + m.arrival.shape[0] * m.width + 1
