"""The house of ARCHITECTURE.md: who imports whom, and what stands where."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.support import sources

HOUSE = Path(__file__).resolve().parents[1] / "gtmodel"
# a line imports only lines above it, and names of its own line where no circle comes of it
LINES = [
    {"lang"}, {"results"}, {"geometry", "linear"}, {"compiler"}, {"plot", "view", "workers"},
    {"measurements", "inference"}, {"mechanics", "vibration", "simulation", "optimize", "cgen"}, {"filtering"},
    {"control", "predictive"}, {"robots"},
    {"kinematics", "motion", "calibrate", "identify", "compliance", "milling", "loop", "fmu", "vision", "modelica",
     "sweep", "certify"},
    {"problem_files"}, {"kinds"},
]  # fmt: skip
LEVEL = {name: n for n, line in enumerate(LINES) for name in sorted(line)}
FILES_ONLY = {"pydantic", "typer", "rich"}
LIBRARIES = [name for name in LEVEL if LEVEL[name] < LEVEL["problem_files"]]


def imports(path: Path, nested: bool = True, types: bool = False) -> Iterator[tuple[str, int]]:
    """Modules that a file imports, absolute, with the line; `nested` also inside functions, `types` also for types."""
    for module, line, inside, for_types in every_import(path, HOUSE):
        if (nested or not inside) and (types or not for_types):
            yield module, line


@cache
def every_import(path: Path, house: Path) -> list[tuple[str, int, bool, bool]]:
    """Modules that a file imports, with the line, whether inside a function, and whether only for types or a hint."""
    nodes = sources.nodes_of(path)
    blocks, bodies = ([range(n.lineno, n.end_lineno + 1) for n in nodes if is_one(n)]
                      for is_one in (_for_types, lambda n: isinstance(n, ast.FunctionDef)))  # fmt: skip
    package = ["gtmodel", *path.relative_to(house).with_suffix("").parts[:-1]]
    made = []
    for node in nodes:
        if isinstance(node, ast.Import):
            modules = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            modules = [module, *(f"{module}.{a.name}" for a in node.names)]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "hint":
            modules = [ast.literal_eval(node.args[0])]
        else:
            continue
        line = node.lineno
        inside = any(line in body for body in bodies)
        for_types = isinstance(node, ast.Call) or any(line in block for block in blocks)
        made += [(module, line, inside, for_types) for module in modules]
    return made


def _for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def part_of(module: str) -> str:
    words = module.split(".")
    return words[1] if words[0] == "gtmodel" and len(words) > 1 else ""


@pytest.mark.parametrize("name", LIBRARIES)
def test_no_library_knows_files_of_problems(name):
    for path in sorted((HOUSE / name).rglob("*.py")):
        for module, line in imports(path):
            assert module.split(".")[0] not in FILES_ONLY, f"{path}:{line} imports {module}"
            assert part_of(module) not in ("kinds", "problem_files", "cli"), f"{path}:{line} imports {module}"


@pytest.mark.parametrize("name", [n for n in LIBRARIES if n != "plot"])
def test_no_library_needs_matplotlib_before_a_picture(name):
    for path in sorted((HOUSE / name).rglob("*.py")):
        for module, line in imports(path, nested=False):
            assert module.split(".")[0] != "matplotlib", f"{path}:{line}"
            assert part_of(module) != "plot", f"{path}:{line}: import the picture where it is drawn"


@pytest.mark.parametrize("name", LIBRARIES)
def test_no_arrow_goes_up(name):
    for path in sorted((HOUSE / name).rglob("*.py")):
        for module, line in imports(path, types=True):
            above = LEVEL.get(part_of(module), 0)
            assert above <= LEVEL[name], (
                f"{path}:{line} imports {module}, which is listed below {name} in ARCHITECTURE.md"
            )


def test_packages_form_no_circle():
    """Imports inside functions, those for types and hints count; engines that `lang` names for its methods, and a
    picture that `results` draws by its name, do not."""
    files = {path: path.relative_to(HOUSE).parts[0] for path in HOUSE.rglob("*.py")}
    graph: dict[str, set[str]] = {name: set() for name in LEVEL}
    for path, name in files.items():
        if name in graph:
            graph[name] |= {part_of(m) for m, _ in imports(path, types=True)} & set(LEVEL) - {name}
    assert circle_of(graph) == []
    assert "milling" not in graph["control"]


def test_hidden_arrows_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.test_house.HOUSE", tmp_path)
    text = (
        "if TYPE_CHECKING:\n    from ..milling import Cut\n"
        "Cutter = hint('gtmodel.kinds', 'Cutter')\n"
        "def f():\n    from .. import vision\n"
    )
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "a.py").write_text(text)
    found = {part_of(module) for module, _ in imports(tmp_path / "control" / "a.py", types=True)}
    assert found >= {"milling", "kinds", "vision"}


def test_robots_are_not_compared_by_name_outside_robots():
    for path in sorted(HOUSE.rglob("*.py")):
        if "robots" in path.relative_to(HOUSE).parts:
            continue
        for node in sources.nodes_of(path):
            if isinstance(node, ast.Compare):
                sides = [node.left, *node.comparators]
                named = any(getattr(s, "id", getattr(s, "attr", "")) == "robot" for s in sides)
                texts = any(isinstance(s, ast.Constant) and isinstance(s.value, str) and s.value for s in sides)
                assert not (named and texts), f"{path}:{node.lineno} compares a robot with a name"


POKE = re.compile(r"__dict__(\[|\.(get|pop|setdefault)\()|(?<!self)\.__dict__\.update")


def test_the_inside_of_a_model_is_the_languages():
    """Elsewhere attributes are read by name and written by methods."""
    for path in sorted(HOUSE.rglob("*.py")):
        if path.relative_to(HOUSE).parts[0] not in ("lang", "_lazy.py"):
            found = POKE.search(path.read_text())
            assert found is None, f"{path}: {found}"


def test_a_poke_is_found():
    for text in ('x.__dict__["_path"]', 'f.__dict__.get("a")', "made.__dict__.update(a=1)"):
        assert POKE.search(text)
    assert not POKE.search("self.__dict__.update(state)")


def test_no_module_imports_another_that_imports_it():
    """At run time: imports inside functions count, those for types do not."""
    modules = {name_of(path): path for path in HOUSE.rglob("*.py")}
    graph = {name: {m for m, _ in imports(path) if m in modules} - {name} for name, path in modules.items()}
    for name in graph:  # `from package import module` needs the module; the package's own __init__ is not meant
        graph[name] = {m for m in graph[name] if not any(other.startswith(f"{m}.") for other in graph[name])}
    assert circle_of(graph) == []


def test_a_circle_is_found():
    assert circle_of({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == ["b", "c", "b"]
    assert circle_of({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def name_of(path: Path) -> str:
    words = ["gtmodel", *path.relative_to(HOUSE).with_suffix("").parts]
    return ".".join(words[:-1] if words[-1] == "__init__" else words)


def circle_of(graph: dict[str, set[str]]) -> list[str]:
    """The first circle of imports, from a module back to it; empty without one."""
    done: set[str] = set()

    def walk(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name not in done:
            for other in sorted(graph[name]):
                if found := walk(other, [*way, name]):
                    return found
            done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


@pytest.mark.parametrize("folder", sorted(p for p in HOUSE.rglob("*") if p.is_dir()), ids=lambda p: p.name)
def test_no_folder_is_crowded(folder):
    assert len(list(folder.glob("*.py"))) <= 30


def without_assertion(text: str) -> list[int]:
    """Lines of tests without `assert`, and without a call of raises, warns or of a name with "assert" in it."""
    nodes = sources.walked(ast.parse(text))
    tests = (n for n in nodes if isinstance(n, ast.FunctionDef) and n.name.startswith("test_"))
    return [test.lineno for test in tests if not any(_asserts(n) for n in ast.walk(test))]


def _asserts(node: ast.AST) -> bool:
    called = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
    return isinstance(node, ast.Assert) or called in ("raises", "warns") or "assert" in called


def test_every_test_holds_its_own_assertion():
    """A helper returns what it found, and the test compares it: whoever reads the test sees what it says."""
    files = sorted(Path(__file__).parent.rglob("test_*.py"))
    assert [f"{path}:{line}" for path in files for line in without_assertion(path.read_text())] == []


def test_a_test_without_an_assertion_is_found():
    helper = "def test_a():\n    check(1)\ndef test_b():\n    np.testing.assert_allclose(1, 1)\n"
    assert without_assertion(helper + "class T:\n    def test_c(self): self.judge()\n") == [1, 6]
    assert without_assertion("def test_a():\n    with pytest.raises(ValueError):\n        int('')\n") == []
    assert without_assertion("def check(a): a.b\ndef test_a(): assert check(1) == []\n") == []


KIND_FILES = {"__init__.py", "keys.py", "kind.py", "page.py"}


def test_kinds_are_thin_doors():
    kinds = HOUSE / "kinds"
    alone = [p for p in kinds.glob("*.py") if p.name != "__init__.py"]
    assert [str(p) for p in alone if len(p.read_text().splitlines()) >= 300] == []
    lines = sum(len(p.read_text().splitlines()) for p in alone)
    for folder in sorted(p for p in kinds.iterdir() if p.is_dir() and any(p.glob("*.py"))):
        assert {p.name for p in folder.glob("*.py")} <= KIND_FILES, folder
        assert len((folder / "kind.py").read_text().splitlines()) < 150, folder
        lines += sum(len(p.read_text().splitlines()) for p in folder.glob("*.py"))
    assert lines < 6000
    assert sum(len(p.read_text().splitlines()) for p in (HOUSE / "problem_files").glob("*.py")) < 3000


def test_notebooks_need_no_kinds():
    for path in sorted((HOUSE.parent / "notebooks").glob("*.py")):
        assert "gtmodel.kinds" not in path.read_text(), f"{path.name} imports gtmodel.kinds"
