"""What `gtmodel.geometry` defines stands there alone: products and matrices of quaternions, cross matrices, rotations
by vectors, fits of rotations, angles. Small pure functions of all other packages are called with arguments of each, and
matrices that are written out are read."""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy
from scipy.spatial.transform import Rotation

HOUSE = Path(__file__).resolve().parents[2] / "gtmodel"
ALLOWED = {
    "modelica/builtin.py": "skew() of the language Modelica is made of operations of its syntax tree",
    "control/lead_through/wrench.py": "mirrors the sums of the C loop bit by bit, without NumPy",
}
NAMES = {
    "skew", "hat", "cross_matrix", "cross_matrices", "rodrigues", "rotation_about", "quaternion_matrix",
    "quaternion_product", "quaternion_of", "zyz_quaternion", "rotation_of_rpy", "nearest_rotation", "rotation_angle",
    "rotation_by", "rotation_vectors", "left_jacobian", "right_handed",
}  # fmt: skip
# what a definition is not written without; reading every file takes longer than all other tests of geometry
SUSPECT = re.compile(
    r"cross|trace|2 \* \(|swapaxes|\[(\.\.\., )?1:4?\]|\[0\] \* \w+\[0\]|0, -[a-z]|zero, -[a-z]|skew|quaternion|"
    r"Rotation\.|linalg\.svd|linalg\.eigh|arccos|acos|[2\*] (np|math)\.pi|tau|nearest_rotation|rotation_by|handed"
)
WRITTEN_OUT = re.compile(r"cross\(.*eye\(|0, -[a-z]|zero, -[a-z]")
LONGEST = 30  # lines of a function that is called
ROOTS = {"np", "ca", "math", "gt", "scipy", "Rotation"}
PLAIN = {
    "float", "sum", "zip", "range", "len", "tuple", "list", "enumerate", "abs", "min", "max", "round", "int",
    "dot", "cross", "sqrt", "vector",
}  # fmt: skip
NAMESPACE: dict[str, Any] = {
    "np": np, "ca": ca, "math": math, "scipy": scipy, "Rotation": Rotation,
    "dot": np.dot, "cross": np.cross, "sqrt": np.sqrt, "vector": np.array,
    "gt": SimpleNamespace(dot=np.dot, cross=np.cross, sqrt=np.sqrt, cos=np.cos, sin=np.sin, vector=np.array),
}  # fmt: skip
ALIKE = 1e-9

TURNS = Rotation.from_rotvec([[0.3, -0.5, 0.9], [0.7, 0.2, -0.4]])
P, Q = TURNS.as_quat(scalar_first=True)
V = np.array([0.36, -0.48, 0.8])
A, B = TURNS.as_matrix()
W = 0.7 * V
FIT = A + np.array([[0.1, 0.0, 0.3], [0.0, -0.2, 0.1], [0.2, 0.0, 0.0]])
POLAR = scipy.linalg.polar(FIT)[0]
ROWS = np.random.default_rng(8).standard_normal((5, 3))
MOVED = ROWS @ A.T
APART = np.array((TURNS[0] * TURNS[1].inv()).magnitude())
ANGLES = np.array([4.0, -4.0, 1.0, -3.0])
FIRST = np.cross(V, np.eye(3)[0]) / np.hypot(V[1], V[2])
CROSS = np.cross(np.eye(3), V)
Made = tuple[str, list[np.ndarray], list[np.ndarray]]
# what is found, of which arguments, as which results
DEFINITIONS: list[Made] = [
    ("a quaternion product", [P, Q], [(TURNS[0] * TURNS[1]).as_quat(scalar_first=True)]),
    ("a quaternion product, scalar last", [TURNS[0].as_quat(), TURNS[1].as_quat()], [(TURNS[0] * TURNS[1]).as_quat()]),
    ("a rotation matrix of a quaternion", [P], [TURNS[0].as_matrix(), TURNS[0].as_matrix().T]),
    ("a quaternion of a rotation matrix", [TURNS[0].as_matrix()], [P, -P]),
    ("a cross matrix", [V], [CROSS, -CROSS]),
    ("Rodrigues' formula", [V, np.array(0.7)], [Rotation.from_rotvec(W).as_matrix()]),
    ("a rotation by a rotation vector", [W], [Rotation.from_rotvec(W).as_matrix()]),
    ("a quaternion of a rotation vector", [W], [Rotation.from_rotvec(W).as_quat(scalar_first=True)]),
    ("a rotation vector of a quaternion", [P], [TURNS[0].as_rotvec()]),
    ("a rotation vector of a rotation", [A], [TURNS[0].as_rotvec()]),
    ("a turned vector", [P, V], [A @ V, A.T @ V]),
    ("an angle between quaternions", [P, Q], [APART]),
    ("an angle between rotations", [A, B], [APART]),
    ("a nearest rotation", [FIT], [POLAR]),
    ("a fit of a rotation", [ROWS, MOVED], [A, A.T]),
    ("angles within pi", [ANGLES], [np.angle(np.exp(1j * ANGLES))]),
    ("axes of a direction", [V], [np.array([V, FIRST, np.cross(V, FIRST)])]),
]


def second_definitions(text: str) -> list[str]:
    """Lines of a module with what they define again."""
    tree = ast.parse(text)
    found = {n: "a name of gtmodel.geometry" for f in tree.body if isinstance(f, ast.FunctionDef)
             if (n := f.lineno) and f.name.strip("_") in NAMES}  # fmt: skip
    twice = text.count("2 * (") >= 3
    for node in ast.walk(tree) if twice or WRITTEN_OUT.search(text) else ():
        if isinstance(node, (ast.List, ast.Tuple)) and _antisymmetric(node):
            found[node.lineno] = "a cross matrix"
        if isinstance(node, ast.Call) and _last(node.func) == "cross" and any(_all_axes(a) for a in node.args):
            found[node.lineno] = "a cross matrix by the unit matrix"
        if twice and isinstance(node, ast.FunctionDef) and sum(map(_twice_two_products, ast.walk(node))) >= 3:
            found[node.lineno] = "a rotation matrix of a quaternion"
    space = _callable(tree)
    for f in tree.body:
        if isinstance(f, ast.FunctionDef) and f.lineno not in found and (what := _evaluated(f, space)):
            found[f.lineno] = what
    return [f"{line}: {what}" for line, what in sorted(found.items())]


def _last(f: ast.expr) -> str:
    return f.attr if isinstance(f, ast.Attribute) else f.id if isinstance(f, ast.Name) else ""


def _all_axes(node: ast.expr) -> bool:
    """np.eye(3), also with further axes; not one of its rows."""
    if isinstance(node, ast.Subscript):
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        whole = all(isinstance(p, ast.Slice) or (isinstance(p, ast.Constant) and p.value is None) for p in parts)
        return whole and _all_axes(node.value)
    return isinstance(node, ast.Call) and _last(node.func) == "eye"


def _antisymmetric(node: ast.List | ast.Tuple) -> bool:
    """[[0, -z, y], [z, 0, -x], [-y, x, 0]] of any x, y, z, also as nine numbers or as rows that are stacked."""
    rows = [_row(e) for e in node.elts]
    flat = node.elts if len(node.elts) == 9 else [e for r in rows for e in r] if list(map(len, rows)) == [3] * 3 else []
    if len(flat) != 9:
        return False
    said = [ast.unparse(e) for e in flat]
    if not said[0] == said[4] == said[8] or said[0] in (said[1], said[2], said[5]):
        return False
    return all(said[a] == f"-{said[b]}" for a, b in ((1, 3), (6, 2), (5, 7)))


def _row(e: ast.expr) -> list[ast.expr]:
    if isinstance(e, ast.Call) and e.args:
        e = e.args[0]
    return e.elts if isinstance(e, (ast.List, ast.Tuple)) else []


def _twice_two_products(node: ast.AST) -> bool:
    """2 * (a * b + c * d)."""
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult) and isinstance(node.right, ast.BinOp)):
        return False
    inner, two = node.right, isinstance(node.left, ast.Constant) and node.left.value == 2
    products = all(isinstance(s, ast.BinOp) and isinstance(s.op, ast.Mult) for s in (inner.left, inner.right))
    return two and products and isinstance(inner.op, (ast.Add, ast.Sub))


def _evaluated(f: ast.FunctionDef, space: dict[str, Any]) -> str:
    """What a function of a module gives of the arguments of a definition."""
    required = len(f.args.args) - len(f.args.defaults)
    if not 1 <= required <= 2 or f.name not in space:
        return ""
    call = space[f.name]
    fitting = [made for made in DEFINITIONS if len(made[1]) == required]
    return next((name for name, *made in fitting if any(_gives(call, form, *made) for form in FORMS)), "")


def _callable(tree: ast.Module) -> dict[str, Any]:
    """The functions of a module that are short and without effects, each by its name."""
    space = dict(NAMESPACE)
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value and _is_constant(node.value):
            with suppress(Exception):
                exec(compile(ast.Module([node], []), "constants", "exec"), space)
    functions = [f for f in tree.body if isinstance(f, ast.FunctionDef)]
    own = {f.name for f in functions}
    for f in functions:
        short = (f.end_lineno or 0) - f.lineno <= LONGEST and len(f.args.args) <= 3 and not f.args.kwonlyargs
        if short and _is_pure(f, own):
            f.decorator_list, f.returns = [], None  # nobody reads them afterwards
            for a in f.args.args:
                a.annotation = None
            with suppress(NameError):  # a default of the module
                exec(compile(ast.Module([f], []), "f", "exec"), space)
    return space


def _is_constant(value: ast.expr) -> bool:
    """A number, or np.eye(3) and the like."""
    calls = [node.func for node in ast.walk(value) if isinstance(node, ast.Call)]
    return all(isinstance(f, ast.Attribute) and isinstance(f.value, ast.Name) and f.value.id == "np" for f in calls)


def _is_pure(f: ast.FunctionDef, others: set[str]) -> bool:
    own, nodes = others | PLAIN, list(ast.walk(f))
    names = own | ROOTS | {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    names |= {a.arg for a in f.args.args}
    for node in nodes:
        if isinstance(node, (ast.While, ast.Import, ast.ImportFrom, ast.With, ast.Yield, ast.YieldFrom, ast.Global)):
            return False
        if isinstance(node, ast.Call):
            root = node.func
            while isinstance(root, (ast.Attribute, ast.Subscript, ast.Call)):
                root = root.func if isinstance(root, ast.Call) else root.value
            if not isinstance(root, ast.Name) or root.id not in (own if root is node.func else names):
                return False
    return True


def _plain(x: np.ndarray) -> Any:
    return x


def _rows(x: np.ndarray) -> Any:
    return x[None] if x.ndim else x


def _column(x: np.ndarray) -> Any:
    return ca.DM(x)


FORMS = [_plain, _rows, _column]


def _gives(call: Callable[..., Any], form: Callable[[np.ndarray], Any], given: list[np.ndarray],
           wanted: list[np.ndarray]) -> bool:  # fmt: skip
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            made = call(*[form(x) for x in given])
            made = made.full() if isinstance(made, ca.DM) else np.asarray(made, float)
    except Exception:  # what takes other arguments defines nothing of these
        return False
    return any(made.size == w.size and np.allclose(made.reshape(w.shape), w, atol=ALIKE) for w in wanted)


def of_house(house: Path) -> Iterator[str]:
    for path in sorted(house.rglob("*.py")):
        name = str(path.relative_to(house))
        text = path.read_text()
        if not name.startswith("geometry/") and name not in ALLOWED and SUSPECT.search(text):
            yield from (f"{name}:{line}" for line in second_definitions(text))


def test_no_second_definition() -> None:
    assert list(of_house(HOUSE)) == [], "use gtmodel.geometry"


def test_what_is_allowed_is_there() -> None:
    assert all((HOUSE / name).is_file() for name in ALLOWED)


PLANTED = [
    "def f(a, b):\n    v = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])\n"
    "    return np.array([a[0] * b[0] - a[1:] @ b[1:], *v])",
    "def f(a, b):\n    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:], b[1:]), "
    "a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))",
    "def f(a, b):\n    u, v, s, t = a[..., :3], b[..., :3], a[..., 3:], b[..., 3:]\n"
    "    return np.concatenate([s * v + t * u + c(u, v), s * t - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)\n"
    "def c(u, v):\n    return np.cross(u, v)",
    "def f(q):\n    K = np.cross(np.eye(3), q[1:]).T\n    return np.eye(3) + 2 * q[0] * K + 2 * K @ K",
    "def f(q):\n    w, x = q[0], q[1:]\n    return (w * w - x @ x) * np.eye(3) + 2 * np.outer(x, x) "
    "+ 2 * w * np.cross(x, np.identity(3)).T",
    "def f(q):\n    w, x, y, z = ca.vertsplit(q)\n    return ca.vertcat(ca.horzcat(1 - 2 * (y * y + z * z), "
    "2 * (x * y - w * z)), 2 * (x * z + w * y))",
    "def f(R):\n    w = np.sqrt(1 + np.trace(R)) / 2\n"
    "    return np.array([w, *(np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 4 / w)])",
    "x, y, z = 1, 2, 3\nK = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]",
    "def f(a):\n    zero = 0 * a[0]\n    x, y, z = a\n    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero])",
    "def f(v):\n    K = np.zeros((len(v), 3, 3))\n"
    "    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]\n"
    "    return K - np.swapaxes(K, 1, 2)",
    "arms = np.cross(np.eye(3)[:, None, None], p)",
    "def f(n, angle):\n    return np.cos(angle) * np.eye(3) + (1 - np.cos(angle)) * np.outer(n, n) "
    "+ np.sin(angle) * np.cross(n, np.identity(3)).T",
    "def skew(x):\n    return unknown(x)",
    "UNIT = np.eye(3)\ndef f(v):\n    return np.cross(v, UNIT).T",
    "def f(v):\n    return scipy.spatial.transform.Rotation.from_rotvec(v).as_matrix()",
    "def f(R):\n    return Rotation.from_matrix(R).as_rotvec()",
    "def f(q, v):\n    t = 2 * np.cross(q[1:], v)\n    return v + q[0] * t + np.cross(q[1:], t)",
    "def f(a, b):\n    return 2 * np.arccos(min(abs(a @ b), 1.0))",
    "def f(R, S):\n    return np.arccos((np.trace(R.T @ S) - 1) / 2)",
    "def f(M):\n    U, _, Vt = np.linalg.svd(M)\n    return U @ Vt",
    "def f(a, b):\n    U, _, V = np.linalg.svd(b.T @ a)\n    return U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V",
    "def f(angle):\n    return (angle + np.pi) % (2 * np.pi) - np.pi",
    "def f(n):\n    c = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])\n    c /= np.linalg.norm(c)\n"
    "    return np.array([n, c, np.cross(n, c)])",
]  # fmt: skip


@pytest.mark.parametrize("text", PLANTED)
def test_a_second_definition_is_found(text: str) -> None:
    assert SUSPECT.search(text) and second_definitions(text)


def test_what_is_alike_is_not_taken_for_one() -> None:
    innocent = (
        "def f(a, b):\n    return a + b\ndef g(q):\n    return -q\ndef h(v):\n    return np.outer(v, v)\n"
        "e = np.cross(n, np.eye(3)[0])\nd = [[0.0, a, b], [a, 0.0, c], [b, c, 0.0]]\n"
    )
    assert second_definitions(innocent) == []
