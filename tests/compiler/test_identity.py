"""What `equations` reads belongs to the identity of a class: no cache answers with what it read before."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.lang.identity import Content

HEAD = "import numpy as np\nimport gtmodel as gt\n"
BODY = """
class Law(gt.Model):
    x = gt.variable()
    u = gt.variable()
    def equations(self):
        yield self.x == {factor} * self.u
"""

# what a factor of 2 is read from, and a line that makes 3 of it
READ: dict[str, tuple[str, str, str]] = {
    "global": ("K = 2.0", "K", "K = 3.0"),
    "function of the module": ("K = 2.0\ndef k():\n    return K", "k()", "K = 3.0"),
    "function of a function": ("K = 2.0\ndef j():\n    return K\ndef k():\n    return j()", "k()", "K = 3.0"),
    "lambda": ("K = 2.0\nk = lambda: K", "k()", "K = 3.0"),
    "function inside": ("K = 2.0", "(lambda: K)()", "K = 3.0"),
    "comprehension": ("K = 2.0", "sum([K for _ in range(1)])", "K = 3.0"),
    "default": ("def k(a=2.0):\n    return a", "k()", "k.__defaults__ = (3.0,)"),
    "keyword default": ("def k(*, a=2.0):\n    return a", "k()", "k.__kwdefaults__ = {'a': 3.0}"),
    "list": ("K = [2.0]", "K[0]", "K[0] = 3.0"),
    "array": ("K = np.array([1.0, 2.0])", "K[1]", "K[1] = 3.0"),
    "dictionary": ("K = {'k': 2.0}", "K['k']", "K['k'] = 3.0"),
    "object": ("class O: pass\no = O()\no.k = 2.0", "o.k", "o.k = 3.0"),
    "object with slots": ("class O:\n    __slots__ = 'k'\no = O()\no.k = 2.0", "o.k", "o.k = 3.0"),
    "attribute of another class": ("class O:\n    k = 2.0", "O.k", "O.k = 3.0"),
    "method of an object": ("class O:\n    k = 2.0\n    def f(self): return self.k\no = O()", "o.f()", "O.k = 3.0"),
    "bound method": ("class O:\n    def f(self): return self.k\no = O()\no.k = 2.0\nf = o.f", "f()", "o.k = 3.0"),
    "own attribute": ("", "self._k", "Law._k = 3.0"),
    "attribute by name": ("", "getattr(self, '_k')", "Law._k = 3.0"),
    "by the module's names": ("K = 2.0", "globals()['K']", "K = 3.0"),
    "another function in its place": ("def k():\n    return 2.0", "k()", "k = lambda: 3.0"),
    "closure": (
        "def made():\n    k = 2.0\n    def read():\n        return k\n    def write(a):\n        nonlocal k\n"
        "        k = a\n    return read, write\nread, write = made()",
        "read()",
        "write(3.0)",
    ),
    "partial": ("from functools import partial\nK = [2.0]\nk = partial(max, K)", "k()", "K[0] = 3.0"),
    "file": ("open('k', 'w').write('2.0')", "float(open('k').read())", "open('k', 'w').write('3.0')"),
    "path": (
        "from pathlib import Path\nP = Path('k')\nP.write_text('2.0')",
        "float(P.read_text())",
        "P.write_text('3.0')",
    ),
    "array of a file": ("np.save('k', 2.0)", "float(np.load('k.npy'))", "np.save('k', 3.0)"),
    "function of numpy": ("from numpy import load\nnp.save('k', 2.0)", "float(load('k.npy'))", "np.save('k', 3.0)"),
    "environment": ("import os\nos.environ['GT_K'] = '2'", "float(os.environ['GT_K'])", "os.environ['GT_K'] = '3'"),
    "module by a text": (
        "import sys, types\nm = sys.modules['gt_of_a_text'] = types.ModuleType('gt_of_a_text')\nm.k = 2.0",
        "sys.modules['gt_of_a_text'].k",
        "m.k = 3.0",
    ),
    "iterator": ("K = [2.0]\ndef g():\n    while True:\n        yield K[0]\ni = g()", "next(i)", "K[0] = 3.0"),
}


def answer(model: gt.Model) -> float:
    return float(model.causal("u", "x")(1.0)[0])


@pytest.mark.parametrize("case", READ)
def test_a_new_instance_reads_what_stands_there_now(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GT_K", "")
    monkeypatch.setitem(sys.modules, "gt_of_a_text", types.ModuleType("gt_of_a_text"))
    before, factor, change = READ[case]
    names: dict[str, Any] = {"__name__": "a_persons_module"}
    exec(HEAD + before + BODY.format(factor=factor), names)
    names["Law"]._k = 2.0
    first = answer(names["Law"]())
    exec(change, names)
    assert (first, answer(names["Law"]())) == (2.0, 3.0)


@pytest.fixture
def two_modules() -> Iterator[Callable[[str, str], dict[str, Any]]]:
    other = types.ModuleType("a_persons_numbers")
    other.K = 2.0  # type: ignore[attr-defined]
    sys.modules[other.__name__] = other

    def law(line: str, factor: str) -> dict[str, Any]:
        names: dict[str, Any] = {"__name__": "a_persons_module"}
        body = BODY.format(factor=factor)
        if "inside" in line:
            line, body = "", body.replace("(self):\n", "(self):\n        from a_persons_numbers import K\n")
        exec(HEAD + line + body, names)
        return names

    yield law
    del sys.modules[other.__name__]


@pytest.mark.parametrize(("line", "factor"), [("import a_persons_numbers as n", "n.K"), ("inside", "K")])
def test_another_modules_number_is_read_too(two_modules: Callable[..., dict[str, Any]], line: str, factor: str):
    names = two_modules(line, factor)
    first = answer(names["Law"]())
    sys.modules["a_persons_numbers"].K = 3.0  # type: ignore[attr-defined]
    assert (first, answer(names["Law"]())) == (2.0, 3.0)


RATE = 1.0


class Decay(gt.Model):
    x = gt.variable(start=1.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == -RATE * self.x


class Steered(gt.Optimization):
    """The least integral of u^2 from 0 to `TO` in 1 s: `TO` squared."""

    x = gt.variable(start=0.0, fixed=True)
    u = gt.input()
    final_time = 1.0

    def equations(self):
        yield gt.der(self.x) == self.u

    def objective(self):
        return gt.integral(self.u**2)

    def constraints(self):
        yield self.x.at(self.final_time) == RATE


class Whole(gt.Model):
    part = gt.part(Decay)


class Derived(Decay):
    pass


def test_every_door_and_the_same_instance_read_it_now(monkeypatch: pytest.MonkeyPatch):
    kept = Decay()
    models: list[Callable[[], gt.Model]] = [Decay, Derived, lambda: kept]
    for rate in (1.0, 2.0):
        monkeypatch.setitem(globals(), "RATE", rate)
        for model in models:
            run = model().simulate(1.0, tolerance=1e-9)
            assert run.trajectory["x"][-1] == pytest.approx(np.exp(-rate), rel=1e-6)  # 1000 tolerances
            assert (
                float(
                    model().causal((), "der(x)", prefer="x")(
                        1.0,
                    )[0]
                )
                == -rate
            )
        assert Whole().simulate(1.0).trajectory["part.x"][-1] == pytest.approx(np.exp(-rate), rel=1e-4)


def test_an_optimization_solved_again_reads_it_now(monkeypatch: pytest.MonkeyPatch):
    kept = Steered()
    for rate in (1.0, 2.0):
        monkeypatch.setitem(globals(), "RATE", rate)
        assert gt.solve(kept, gt.Mesh(2)).objective == pytest.approx(rate**2, rel=1e-7)  # of IPOPT


def test_what_has_not_changed_is_shared_still():
    assert flat_of(Decay()) is flat_of(Decay())
    assert flat_of(Whole()) is flat_of(Whole())
    assert all(Content(model).whole for model in (Decay(), Whole(), gt.robots.gantry_tau("l1_tape")))


def test_a_class_that_reads_what_shows_no_content_is_not_shared():
    names: dict[str, Any] = {"__name__": "a_persons_module"}
    exec(HEAD + "import io\nfile = io.StringIO('2')" + BODY.format(factor="float(file.getvalue())"), names)
    assert flat_of(names["Law"]()) is not flat_of(names["Law"]())
