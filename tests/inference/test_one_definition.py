"""One damped descent, one F distribution in gtmodel: a second one is found by its calls, or the shape of its loop."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterable, Iterator

import pytest

from tests.support import sources

HOUSE = sources.HOUSE
DESCENTS = {"least_squares", "leastsq", "curve_fit", "lsq_linear"}  # of scipy.optimize
F = {
    "fdtr",
    "fdtrc",
    "fdtri",
    "betainc",
    "betaincc",
    "betaincinv",
    "betainccinv",
    "btdtr",
    "btdtri",
}  # of scipy.special
OF_STATS = {"f", "beta", "chi2", "t", "norm"}  # of scipy.stats: chance.py and half_width have them without its import
# bounded linear fits; solvers of equations, which raise and lower a damping or a step but fit no residuals
DESCENT_HOMES = {"inference/descent.py", "inference/least_squares.py"}
EQUATIONS = {"compiler/newton.py", "calibrate/closure.py", "geometry/chains/numerical.py"}
F_HOMES = {"inference/chance.py"}


def called(nodes: Iterable[ast.AST], words: set[str]) -> Iterator[tuple[int, str]]:
    """Lines and dotted names of what is used as an attribute or imported from SciPy, if it ends with one of the words;
    what stands before the last word is a node of its own."""
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr in words:
            yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy"):
            yield from ((node.lineno, f"{node.module}.{name.name}") for name in node.names)


def descents(nodes: list[ast.AST]) -> list[int]:
    """Lines of calls of SciPy's fits, and of loops that scale one variable both up and down by factors."""
    lines = [n for n, name in called(nodes, DESCENTS) if name.split(".")[-1] in DESCENTS and "." in name]
    for loop in (n for n in nodes if isinstance(n, (ast.For, ast.While))):
        factors: dict[str, set[str]] = {}
        for node in ast.walk(loop):
            if isinstance(node, ast.AugAssign):
                name, value = variable(node.target), ast.BinOp(node.target, node.op, node.value)
                factors.setdefault(name, set()).update(scalings(value, name))
            elif isinstance(node, ast.Assign):
                for name in map(variable, node.targets):
                    factors.setdefault(name, set()).update(scalings(node.value, name))
        if any(len(of) > 1 for of in factors.values()):
            lines.append(loop.lineno)
    return sorted(set(lines))


def variable(node: ast.expr) -> str:
    """The name of a variable, also of some of its rows."""
    return variable(node.value) if isinstance(node, ast.Subscript) else ast.unparse(node)


def scalings(value: ast.expr, name: str) -> Iterator[str]:
    """Factors by which an expression multiplies or divides the variable it is assigned to: numbers and constants."""
    for node in ast.walk(value):
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
            for own, factor in ((node.left, node.right), (node.right, node.left)):
                number = isinstance(factor, ast.Constant) or (isinstance(factor, ast.Name) and factor.id.isupper())
                if variable(own) == name and number:
                    yield f"{type(node.op)}{ast.unparse(factor)}"


def f_distributions(nodes: list[ast.AST]) -> list[int]:
    """Lines that use the F distribution, or another one that has its home, of SciPy."""
    lines = set()
    for line, name in called(nodes, F | OF_STATS):
        parts = name.split(".")
        if parts[-1] in F or any(a == "stats" and b in OF_STATS for a, b in itertools.pairwise(parts)):
            lines.add(line)
    return sorted(lines)


def found(finder, homes: set[str]) -> list[str]:
    files = {p.relative_to(HOUSE).as_posix(): nodes for p, nodes in sources.house().items()}
    return [f"{p}:{line}" for p, nodes in files.items() if p not in homes for line in finder(nodes)]


def nodes_of(text: str) -> list[ast.AST]:
    return list(ast.walk(ast.parse(text)))


def test_fits_go_down_by_one_descent():
    assert found(descents, DESCENT_HOMES | EQUATIONS) == []


def test_the_f_distribution_has_one_home():
    assert found(f_distributions, F_HOMES) == []


def test_the_homes_are_found():
    assert all(descents(sources.nodes_of(HOUSE / name)) for name in (*DESCENT_HOMES, *EQUATIONS))
    assert all(f_distributions(sources.nodes_of(HOUSE / name)) for name in F_HOMES)


PLANTED = {
    "mu": "while True:\n    if better:\n        mu /= 3\n    else:\n        mu *= 2\n",
    "lam": "for _ in range(9):\n    lam = lam * EASIER if new < cost else lam * HARDER\n",
    "rows": "for _ in range(9):\n    damping = np.clip(np.where(better, damping / 10, 10 * damping), LEAST, MOST)\n",
    "scipy": "x = scipy.optimize.least_squares(f, x).x\n",
    "imported": "from scipy.optimize import curve_fit\n",
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_descent_is_found(name):
    assert descents(nodes_of(PLANTED[name]))


def test_halving_a_step_and_growing_a_bracket_are_no_descents():
    assert descents(nodes_of("for _ in range(9):\n    step /= 2\n    high *= 1.5\n")) == []


@pytest.mark.parametrize(
    "text",
    [
        "p = float(stats.f.sf(F, 3, 9))\n",
        "p = scipy.special.fdtrc(3, 9, F)\n",
        "from scipy.stats import f\n",
        "from scipy.special import betainc\n",
        "q = scipy.stats.t.isf(0.01, 9)\n",
    ],
)
def test_a_planted_f_test_is_found(text):
    assert f_distributions(nodes_of(text))


def test_another_f_is_not():
    assert f_distributions(nodes_of("y = self.f(x) + stats.kurtosis(r) + block.f.sf\n")) == []
