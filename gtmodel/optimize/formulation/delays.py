"""Delayed inputs: equal to the input some elements earlier, or to the declared history before the start."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.flat import FlatModel
from ...compiler.matrices import SparseMatrix
from ...lang.bind import join
from ...lang.model import Connector, Model
from ...lang.optimization import Delayed
from ...lang.source import ModelError
from ..collocation import Layout
from ..mesh import Mesh, control_basis
from .dynamic import DynamicProblem

ROUND_OFF = 1e-9  # of fractions of the horizon


@dataclass(eq=False)
class DelayRows:
    """Rows matrix @ [y_0, ..., y_(N-1)] == value."""

    matrix: SparseMatrix
    value: np.ndarray
    names: list[str]


def delays_of(flat: FlatModel) -> dict[int, tuple[int, Delayed]]:
    """Return, by variable index of each delayed input, the index of its source input and the declaration.

    Raises ModelError if the source is not an input of the same class.
    """
    delays: dict[int, tuple[int, Delayed]] = {}
    for component in _components(flat.root):
        path = component._path
        for name, item in type(component)._declared.items():
            if not isinstance(item, Delayed):
                continue
            delayed_name, source_name = join(path, name), join(path, item.source.name)
            shape, indices = flat.groups.get(source_name, (None, []))
            if shape is None or flat.variables[indices[0]].role != "input":
                raise ModelError(f"'{delayed_name}' delays '{source_name}', not an input of {flat.title}", item.where)
            for delayed, source in zip(flat.groups[delayed_name][1], indices, strict=True):
                delays[delayed] = (source, item)
    return delays


def _components(model: Model) -> Iterator[Model]:
    """Yield a bound model and the parts below it."""
    yield model
    for value in model._values.values():
        for part in value if isinstance(value, (list, tuple)) else (value,):
            if isinstance(part, Model) and not isinstance(part, Connector) and part._parent is model:
                yield from _components(part)


def delay_rows(problem: DynamicProblem, mesh: Mesh, layout: Layout) -> DelayRows:
    """Return rows for every delayed input at every point. Raises ModelError if a delay does not fit the mesh."""
    N, n, K = mesh.elements, layout.size, mesh.points
    if not problem.delayed:
        return DelayRows(SparseMatrix.of([], [], [], (0, N * n)), np.zeros(0), [])
    title, horizon = problem.flat.title, ca.Function("ends", [problem.P], [problem.t0, problem.tf])
    if not (problem.t0.is_constant() and problem.tf.is_constant()) or mesh.length_ratio is not None:
        raise ModelError(f"{title}: a delayed input needs a fixed horizon and fixed element lengths")
    t0, tf = (float(v) for v in horizon(np.zeros(problem.P.numel())))
    rows, cols, weights, value, names = [], [], [], [], []
    for j, (source, item) in enumerate(problem.delayed):
        shift = item.tau / (tf - t0)
        earlier = mesh.edges - shift
        off_edge = [e for e in earlier if -ROUND_OFF < e and np.min(np.abs(mesh.edges - e)) > ROUND_OFF]
        if off_edge or (shift < 1.0 and np.min(np.abs(earlier)) > ROUND_OFF):
            raise ModelError(
                f"{title}: the delay of {item.tau:g} s is not a whole number of elements; choose the mesh so that "
                f"{item.tau:g} s before each edge there is an edge too",
                item.where,
            )
        for k in range(N):
            inside = (mesh.edges > earlier[k] + ROUND_OFF) & (mesh.edges < earlier[k + 1] - ROUND_OFF)
            if np.any(inside):
                # the input may jump there, which a single polynomial cannot represent
                raise ModelError(
                    f"{title}: element {k + 1} takes the delayed input from two elements, which meet at "
                    f"{t0 + mesh.edges[inside][0] * (tf - t0):g} s; choose the mesh "
                    f"so that {item.tau:g} s after each edge there is an edge too",
                    item.where,
                )
        delayed_scale, source_scale = problem.u_scale[layout.nu + j], problem.u_scale[source]
        name = problem.point_names[j]
        for k in range(N):
            for c in range(K):
                s = mesh.edges[k] + mesh.h[k] * mesh.table.points[c] - shift
                row = len(value)
                rows.append(row)
                cols.append(k * n + int(layout.z[c, j]))
                weights.append(1.0)
                names.append(f"delay of {name} in element {k + 1}, point {c + 1}")
                if s <= ROUND_OFF and mesh.edges[k] - shift < -ROUND_OFF:
                    value.append(item.before(t0 + s * (tf - t0)) / delayed_scale)
                    continue
                value.append(0.0)
                e = mesh.element_at(earlier[k])
                local = np.clip((s - mesh.edges[e]) / mesh.h[e], 0.0, 1.0)
                weights_at = control_basis(mesh.control, mesh.table, np.array([local]))[0]
                for weight, i in zip(weights_at, layout.u[:, source], strict=True):
                    rows.append(row)
                    cols.append(e * n + int(i))
                    weights.append(-float(weight) * source_scale / delayed_scale)
    return DelayRows(SparseMatrix.of(rows, cols, weights, (len(value), N * n)), np.array(value), names)
