"""Models and functions in another process: equal numbers to the last bit, equal C text, compiled once."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import gtmodel as gt
from docs._ext.public_names import LIBRARIES, public
from gtmodel._files import problems_dir
from gtmodel._pickling import Portable, dumps
from gtmodel.compiler.flat_cache import flat_of, with_values
from tests.support.commands import environment
from tests.support.mechanisms import FourBar, dropped
from tests.support.pickled import answers, content, content_of, sent_again

MODELS = problems_dir() / "models"


@pytest.fixture(scope="module")
def worker() -> Iterator[Executor]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield pool


class Slider(gt.Model):
    """A model of a module, which another process imports."""

    L = gt.parameter(1.0, unit="m", positive=True)
    x = gt.variable(unit="m", start=0.6)
    y = gt.variable(unit="m", start=-0.8)

    def equations(self):
        yield self.x**2 + self.y**2 == self.L**2
        yield gt.branch("below", -self.y)


def local(factor: float) -> gt.Model:
    """A class of a function, with a variable of that function."""

    class Local(gt.Model):
        x = gt.variable(unit="m")
        y = gt.variable(unit="m")

        def equations(self):
            yield self.y == factor * self.x

    return Local()


def built() -> gt.Builder:
    m = gt.Builder("oscillator")
    k, mass = m.parameter("k", 100.0, unit="N/m"), m.parameter("mass", 3.0, unit="kg")
    x = m.variable("x", unit="m", start=1.0)
    m.add(mass * gt.der(x, 2) == -k * x)
    return m


def near(function: Any) -> list[np.ndarray]:
    """Rows of arguments near the home pose; synthetic, seed 4."""
    rng = np.random.default_rng(4)
    start = {v.index: v.start or 0.0 for v in function.flat.variables}
    rows = []
    for signal in function.inputs:
        middle = np.array([start[i] if order == 0 else 0.0 for i, order in signal.pairs]).reshape(signal.shape)
        rows.append(middle + 0.01 * rng.normal(size=(20, *signal.shape)))
    return rows


def mop() -> Any:
    return gt.modelica.load(f"{MODELS / 'furuta_pendulum.mop'}")()


def furuta() -> gt.Model:
    return gt.modelica.load(f"{MODELS / 'furuta_pendulum.mop'}:Pendulum")()


CASES = {
    "catalogue": lambda: gt.robots.make("l1_tape").causal(known="T", targets=["q", "der(q)"]),
    "catalogue, Newton": lambda: gt.robots.make("d1_six_link").causal(known="q", targets="T"),
    "serial": lambda: gt.robots.make("kr500").causal(known="q", targets="T"),
    "urdf": lambda: gt.robots.from_urdf(MODELS / "arm.urdf").causal(known="q", targets=["T", "tau"]),
    "modelica": lambda: furuta().causal(known="u", targets="der(hinge.phi,2)", prefer=["shoulder.phi", "hinge.phi"]),
    "known rotation": lambda: gt.robots.make("f1").causal(known=["T", "e"], targets="q"),
    "loop": lambda: dropped(FourBar).causal(known="crank.phi", targets="rocker.phi"),
    "module": lambda: Slider(L=2.0).causal(known="x", targets="y", branches={"below": -1}),
    "local": lambda: local(3.0).causal(known="x", targets="y"),
    "builder": lambda: built().causal(targets="der(x,2)", prefer="x"),
    "device": lambda: gt.calibrate.seen_by_plane(
        gt.robots.gantry_tau("l1_tape"), normal=[0, 0, 1], point=[0, 0, 0.1]
    ).causal(known="T", targets="height"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_causal_function_elsewhere_gives_equal_numbers_and_equal_c(case: str, worker: Executor) -> None:
    function = CASES[case]()
    data = dumps((function, near(function)))
    values, texts, once = worker.submit(answers, data).result()
    here, texts_here, _ = answers(data)
    direct = [np.asarray(x).tobytes() for x in function(*near(function))]
    assert values == here == direct
    assert texts == texts_here and any(name.endswith(".c") for name in texts)
    assert once


def test_a_regressor_with_newton_blocks_elsewhere(worker: Executor) -> None:
    regressor = gt.identify.Regressor(gt.robots.make("d1_six_link"), ["m_p"])
    assert worker.submit(content_of, dumps(regressor)).result() == content(regressor)


PUBLIC = {
    f"{library}.{name}": item
    for library in ["", *LIBRARIES]
    for name, item in public(library).items()
    if inspect.isclass(item) and not getattr(item, "_is_protocol", False)
}


def filled(cls: type) -> Any:
    """An object of a class with numbers and functions in its fields; None if only its library makes it."""
    if issubclass(cls, BaseException):
        made = {"solution": gt.results.Study(status=gt.SolveStatus.FAILED, message="one sentence")}
        made["simulation"] = made["solution"]
        named = [p for p in inspect.signature(cls.__init__).parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
        needed = [p.name for p in named if p.name != "self" and p.default is p.empty]
        error = cls(*(made.get(name, "one sentence") for name in needed or [""]))
        error.add_note("the traceback of a worker")
        return error
    if not is_dataclass(cls) or inspect.isabstract(cls):
        return None
    given = {"status": gt.SolveStatus.SOLVED, "message": "", "title": ""}
    function = (lambda: 1.0) if issubclass(cls, Portable) else near
    value = cls.__new__(cls)
    for number, field in enumerate(fields(cls)):
        with suppress(AttributeError):  # a property
            number_or_function = function if "Callable" in str(field.type) else 0.5 + number
            object.__setattr__(value, field.name, given.get(field.name, number_or_function))
    return value


def test_every_public_class_survives_the_standard_module() -> None:
    """Whatever its constructor takes; what its objects hold is tested with the examples of the docstrings."""
    for name, cls in PUBLIC.items():
        assert pickle.loads(pickle.dumps(cls)) is cls, name
        value = filled(cls)
        if value is None:
            continue
        back = pickle.loads(pickle.dumps(value))
        assert type(back) is cls and content(back) == content(value), name
        if isinstance(value, BaseException):
            assert str(back) == str(value) and back.__notes__ == value.__notes__, name


def test_a_linear_system_elsewhere(worker: Executor) -> None:
    system = control.StateSpace([[0.5, 0.1], [0.0, 0.4]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], 0.01)
    back = pickle.loads(worker.submit(sent_again, dumps(system)).result())
    assert [getattr(back, x).tobytes() for x in "ABCD"] == [getattr(system, x).tobytes() for x in "ABCD"]
    assert back.dt == system.dt


def test_modelica_text_elsewhere(worker: Executor) -> None:
    model = mop()
    assert worker.submit(content_of, dumps(flat_of(model).equations)).result() == content(flat_of(model).equations)
    back = pickle.loads(worker.submit(sent_again, dumps(model)).result())
    assert back is model  # what comes back is the model that was sent


def test_classes_of_a_script_and_of_a_file(tmp_path: Path, worker: Executor) -> None:
    """`__main__` and `file.py:Class` are modules that no other process can import."""
    (tmp_path / "own.py").write_text(
        "import gtmodel as gt\nFACTOR = 2.5\nclass Own(gt.Model):\n    x = gt.variable(unit='m')\n"
        "    y = gt.variable(unit='m')\n    def equations(self):\n        yield self.y == FACTOR * self.x\n"
    )
    script = (tmp_path / "own.py").read_text() + (
        "from pathlib import Path\nfrom gtmodel.problem_files.base import Context\n"
        "from gtmodel.problem_files.python_models import resolve\nimport pickle, sys\n"
        "there = resolve('own.py:Own', Context(folder=Path(sys.argv[1])), 'robot')\n"
        "for n, model in enumerate((Own(), there)):\n"
        "    f = model.causal(known='x', targets='y')\n"
        "    Path(sys.argv[1], f'{n}.bin').write_bytes(pickle.dumps(f))\n"
    )
    (tmp_path / "script.py").write_text(script)
    subprocess.run([sys.executable, "script.py", tmp_path], cwd=tmp_path, env=environment(), check=True)
    for n in range(2):
        function = worker.submit(pickle.loads, (tmp_path / f"{n}.bin").read_bytes()).result()
        assert function(2.0)[0] == 5.0


def test_equal_models_are_loaded_once() -> None:
    first, second = (pickle.loads(dumps(Slider(L=3.0))) for _ in range(2))
    assert first is second
    assert flat_of(first) is flat_of(Slider(L=3.0))
    changed = with_values(flat_of(Slider()), {0: 1.5})
    assert pickle.loads(dumps(changed)).p0.tolist() == [1.5]


def test_symbols_of_one_model_stay_the_same_symbols() -> None:
    function = built().causal(targets="der(x,2)", prefer="x")
    plan, flat = pickle.loads(pickle.dumps((function.plan, function.flat)))
    assert plan.flat is flat
    inside = flat.scope.symbols_in(plan.blocks[0].assignments[0][1])
    assert inside == ((0, 0),)


def test_a_builder_is_a_copy_that_can_go_on() -> None:
    m = built()
    other = pickle.loads(pickle.dumps(m))
    other.add(other.variable("y", unit="m") == 2 * other.part("s", Slider()).x)
    assert "y" not in m.names() and "y" in other.names()
    old = m.causal(targets="der(x,2)", prefer="x")
    m.add(m.variable("z") == 0)
    assert pickle.loads(pickle.dumps(old))(0.5)[0] == old(0.5)[0]


def test_copies() -> None:
    robot = gt.robots.make("l1_tape")
    function = robot.causal(known="q", targets="T")
    assert copy.deepcopy(robot) is robot and copy.copy(function) is function
    checks = {"residual_m": gt.results.at_most(1e-3, 2e-3)}
    study = gt.results.Study(status=gt.SolveStatus.SOLVED, checks=checks)
    for other in (copy.copy(study), copy.deepcopy(study), pickle.loads(pickle.dumps(study))):
        assert other is not study and content(other) == content(study)
    assert copy.deepcopy(study).checks is not study.checks and copy.copy(study).checks is study.checks


def test_what_cannot_be_sent_is_named() -> None:
    with pytest.raises(pickle.PicklingError, match="generator"):
        dumps({"rows": (x for x in ())})


def test_a_class_that_comes_back_keeps_its_functions(worker: Executor) -> None:
    model = local(2.0)
    equations = type(model).equations
    back = pickle.loads(worker.submit(sent_again, dumps(model)).result())
    assert back is model and type(model).equations is equations
