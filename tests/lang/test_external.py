"""Functions from elsewhere inside equations: written out, and as calls, against the same model with gt.sin."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.cgen.real import GenerationError
from gtmodel.compiler.toolchain import find

# An exact sine: the same operations in another order, and integrators at equal tolerance.
ROUND_OFF = 1e-12
# Cubic spline through 401 points of the sine on [-4, 4], h = 0.02: errors of h^4 / 384 in the value and h^3 / 24 in the
# slope.
SPLINE, SLOPE = 1e-9, 1e-6


def written() -> ca.Function:
    x = ca.MX.sym("x")
    return ca.Function("sine", [x], [ca.sin(x)])


def call() -> ca.Function:
    x = ca.MX.sym("x")
    return ca.Function("sine", [x], [ca.sin(x)], {"never_inline": True})


def table() -> ca.Function:
    grid = np.linspace(-4, 4, 401)
    return ca.interpolant("table", "bspline", [grid], np.sin(grid))


class Callback(ca.Callback):
    """The sine by NumPy, with its first derivatives by NumPy too, up to order `last`."""

    def __init__(self, derivative: int = 0, last: int = 4) -> None:
        ca.Callback.__init__(self)
        self.derivative, self.last, self.below = derivative, last, None
        self.construct(f"numpy_{derivative}", {})

    def eval(self, arg):
        return [np.sin(float(arg[0]) + self.derivative * np.pi / 2)]

    def has_jacobian(self) -> bool:
        return self.derivative < self.last

    def get_jacobian(self, name, inames, onames, opts):
        self.below = Callback(self.derivative + 1, self.last)  # must live as long as the function
        x, out = ca.MX.sym("x"), ca.MX.sym("out")
        return ca.Function(name, [x, out], [self.below(x)], inames, onames)


def pendulum(sine: Callable) -> type[gt.Model]:
    class Pendulum(gt.Model):
        m = gt.parameter(1.0, unit="kg")
        L = gt.parameter(0.5, unit="m")
        g = gt.parameter(9.81, unit="m/s2")
        phi = gt.variable(unit="rad", start=0.5, fixed=True)
        w = gt.variable(unit="rad/s", start=0.0, fixed=True)
        h = gt.variable(unit="1")
        tau = gt.input(unit="N.m")

        def equations(self):
            yield der(self.phi) == self.w
            yield self.m * self.L**2 * der(self.w) == self.tau - self.m * self.g * self.L * sine(self.phi)
            yield self.h == sine(self.phi)

    return Pendulum


def answers(model: type[gt.Model]) -> dict[str, np.ndarray]:
    """Values in both directions, derivatives, a simulation and an optimum."""

    class Swing(model, gt.Optimization):
        one = gt.parameter(1.0, unit="N.m")
        tau = gt.input(unit="N.m", min=-5.0, max=5.0)
        final_time = 1.0

        def objective(self):
            return gt.integral((self.tau / self.one) ** 2)

        def constraints(self):
            yield self.phi.at(self.final_time) == 0.0
            yield self.w.at(self.final_time) == 0.0

    m, rows = model(), np.linspace(-0.9, 0.9, 7)
    along = (rows, np.full(7, 0.1), np.full(7, 0.3))
    numbers = {
        "value": m.causal(known="phi", targets="h")(rows),
        "inverse": m.causal(known="h", targets="phi")(rows),
        "torque": m.causal(known="phi", targets="tau")(*along),
        "second derivative": m.causal(known="phi", targets="der(h,2)")(*along),
    }
    assert all(np.all(np.asarray(status) == 0) for _, status in numbers.values())
    simulated = gt.simulate(m, 1.0, inputs={"tau": 0.1}).trajectory["phi"][-1]
    optimum = gt.solve(Swing(), gt.Mesh(10)).objective
    return {n: v for n, (v, _) in numbers.items()} | {"simulated": simulated, "optimum": optimum}


@pytest.fixture(scope="module")
def expected() -> dict[str, np.ndarray]:
    return answers(pendulum(gt.sin))


@pytest.mark.parametrize(
    "make, opaque, value, slope",
    [
        (written, False, ROUND_OFF, ROUND_OFF),
        (call, True, ROUND_OFF, ROUND_OFF),
        (Callback, True, ROUND_OFF, ROUND_OFF),
        (table, True, SPLINE, SLOPE),
    ],
)
def test_equal_to_the_sine_of_the_language(make, opaque, value, slope, expected):
    sine = gt.external(make(), inputs=["rad"], outputs=["1"])
    assert sine.opaque is opaque
    found = answers(pendulum(sine))
    for name in ("value", "torque"):
        assert found[name] == pytest.approx(expected[name], abs=10 * value), name
    # Newton stops at a step of 1e-9 at most; a spline's inverse and second derivative show its slope's error
    assert found["inverse"] == pytest.approx(expected["inverse"], abs=max(1e-9, 10 * value))
    assert found["second derivative"] == pytest.approx(expected["second derivative"], abs=10 * slope)
    # integrator and IPOPT: tolerances 1e-8 each
    assert found["simulated"] == pytest.approx(expected["simulated"], abs=1e-6)
    assert found["optimum"] == pytest.approx(expected["optimum"], rel=1e-6)


def test_a_function_compiled_from_c(tmp_path: Path):
    lift = gt.external(library(tmp_path), inputs=["rad"], outputs=["m"])
    assert lift.opaque

    class Cam(gt.Model):
        phi = gt.variable(unit="rad", start=0.5)
        height = gt.variable(unit="m")

        def equations(self):
            yield self.height == lift(self.phi)

    height, status = Cam().causal(known="phi", targets="height")(1.0)
    assert status.ok and height == pytest.approx(0.02 * np.sin(1.0) ** 2, abs=1e-15)
    speed, _ = Cam().causal(known="phi", targets="der(height)")(1.0, 2.0)
    assert speed == pytest.approx(0.02 * np.sin(2.0) * 2.0, abs=1e-15)
    phi, status = Cam().causal(known="height", targets="phi")(0.01)
    assert status.ok and phi == pytest.approx(np.pi / 4, abs=1e-8)


def test_vectors_and_scaled_units():
    """Two inputs (a vector in mm, an angle in deg), two outputs; by hand in NumPy."""
    r, a = ca.MX.sym("r", 2), ca.MX.sym("a")
    f = ca.Function("turned", [r, a], [ca.vertcat(r[0] + a, r[1] * a, r[0]), ca.sumsqr(r)], ["r", "a"], ["v", "n"])
    turned = gt.external(f, inputs=["mm", "deg"], outputs=["N", "mm2"])

    class Two(gt.Model):
        r = gt.variable(2, unit="m")
        a = gt.variable(unit="rad")
        v = gt.variable(3, unit="N")
        n = gt.variable(unit="m2")

        def equations(self):
            v, n = turned(self.r, self.a)
            yield self.v == v
            yield self.n == n

    (v, n), status = (lambda *x: (x[:-1], x[-1]))(*Two().causal(known=["r", "a"], targets=["v", "n"])([0.1, 0.2], 0.5))
    degrees = np.degrees(0.5)
    assert status.ok and v == pytest.approx([100 + degrees, 200 * degrees, 100.0], rel=1e-14)
    assert n == pytest.approx(0.1**2 + 0.2**2, rel=1e-14)


def test_the_function_belongs_to_the_identity_of_the_class():
    """Two classes from one factory differ only in the function that they read."""
    x = ca.MX.sym("x")
    values = []
    for power in (2, 3):
        model = pendulum(gt.external(ca.Function("f", [x], [x**power]), ["rad"], ["1"]))
        values.append(model().causal(known="phi", targets="h")(0.5)[0])
    assert values == pytest.approx([0.25, 0.125])


@pytest.mark.parametrize("make", [written, call, table])
def test_pickled(make):
    f = pickle.loads(pickle.dumps(gt.external(make(), ["rad"], ["1"])))
    assert repr(f) == repr(gt.external(make(), ["rad"], ["1"]))
    assert pendulum(f)().causal(known="phi", targets="h")(0.5)[0] == pytest.approx(np.sin(0.5), abs=SPLINE)


def test_explained():
    model = pendulum(gt.external(table(), ["rad"], ["1"]))()
    assert "h from phi" in model.causal(known="phi", targets="h").explain()


def nested() -> ca.Function:
    """A call within a call, whose second value is not used and whose second argument is zero: null pointers in C."""
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    inner = ca.Function("inner", [x, a], [ca.sin(x) + a * x, ca.exp(x)], {"never_inline": True})
    z = ca.MX.sym("z")
    return ca.Function("outer", [z], [inner(z, 0)[0]], {"never_inline": True})


def map_of_two() -> ca.Function:
    """A table of two arguments, at one value of the second."""
    x, second = np.linspace(-4, 4, 401), np.linspace(0.0, 1.0, 5)
    both = ca.interpolant("map", "bspline", [x, second], np.tile(np.sin(x), 5))
    z = ca.MX.sym("z")
    return ca.Function("cut", [z], [both(ca.vertcat(z, 0.3))])


def lines() -> ca.Function:
    grid = np.linspace(-4, 4, 401)
    return ca.interpolant("lines", "linear", [grid], np.sin(grid))


@pytest.mark.parametrize("make", [written, table, nested, lines, pytest.param(map_of_two, marks=pytest.mark.proof)])
def test_c_is_python_bit_for_bit(make, tmp_path: Path):
    if isinstance(find(), str):
        pytest.skip("no compiler")
    model = pendulum(gt.external(make(), ["rad"], ["1"]))()
    functions = {"torque": model.causal(known="phi", targets="tau")}
    if make in (written, table):
        functions["angle"] = model.causal(known="h", targets="phi")
    study = gt.cgen.study(functions, tmp_path / "c", name="pendulum", costs=make is map_of_two)
    assert study.status.ok, study.message
    if make is map_of_two:  # frames of called functions count: the caller's alone has 304
        assert study.stack_bytes["gt_pendulum_torque"] > 400


def library(folder: Path) -> ca.Function:
    """A shared library with derivatives, as another program would deliver it."""
    chain = find()
    if isinstance(chain, str):
        pytest.skip(chain)
    import subprocess

    x = ca.SX.sym("x")
    f = ca.Function("lift", [x], [0.02 * ca.sin(x) ** 2])
    generator = ca.CodeGenerator("lift.c")
    for g in (f, f.jacobian(), f.jacobian().jacobian()):
        generator.add(g)
    generator.generate(f"{folder}/")
    target = folder / "lift.so"
    subprocess.run([*chain.cc.split(), "-shared", "-fPIC", "-O1", str(folder / "lift.c"), "-o", str(target), "-lm"],
                   check=True)  # fmt: skip
    return ca.external("lift", str(target))


def inside(_: Path) -> ca.Function:
    x, sine = ca.MX.sym("x"), Callback()
    KEPT.append(sine)
    return ca.Function("inside", [x], [sine(x) + x])


KEPT: list[ca.Function] = []  # a callback must live as long as the functions that call it


@pytest.mark.parametrize("make", [lambda _: Callback(), inside, library])
def test_no_c_of_a_callback_or_a_library(make, tmp_path: Path, capfd):
    function = make(tmp_path)
    model = pendulum(gt.external(function, ["rad"], ["1"]))()
    with pytest.raises(GenerationError) as error:
        gt.cgen.generate({"torque": model.causal(known="phi", targets="tau")}, tmp_path / "c", name="p")
    assert error.value.argument == "functions" and f"'{function.name()}'" in str(error.value)
    assert capfd.readouterr().err == ""


def test_no_call_in_float(tmp_path: Path):
    model = pendulum(gt.external(call(), ["rad"], ["1"]))()
    with pytest.raises(GenerationError) as error:
        gt.cgen.generate({"torque": model.causal(known="phi", targets="tau")}, tmp_path / "c", name="p", real="float")
    assert error.value.argument == "real"


def test_a_call_beside_a_sign_asks_for_an_equation_of_its_own():
    sine = gt.external(call(), ["rad"], ["1"])

    class Rubbing(pendulum(gt.sin)):
        def equations(self):
            yield der(self.phi) == self.w
            yield self.m * self.L**2 * der(self.w) == self.tau - self.m * self.g * self.L * (
                sine(self.phi) + 0.1 * gt.sign(self.w)
            )
            yield self.h == sine(self.phi)

    class Apart(pendulum(gt.sin)):
        def equations(self):
            yield der(self.phi) == self.w
            yield self.m * self.L**2 * der(self.w) == self.tau - self.m * self.g * self.L * (
                self.h + 0.1 * gt.sign(self.w)
            )
            yield self.h == sine(self.phi)

    apart = gt.simulate(Apart(), 0.3, inputs={"tau": 0.0}).trajectory["phi"][-1]
    try:
        together = gt.simulate(Rubbing(), 0.3, inputs={"tau": 0.0}).trajectory["phi"][-1]
    except ModelError as error:
        assert "equation of its own" in str(error)
    else:
        assert together == pytest.approx(apart, abs=1e-7)


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ((np.sin, ["rad"], ["1"]), "takes a ca.Function; found ufunc"),
        ((written(), ["rad", "1"], ["1"]), "sine has 1 inputs; expected as many units, found 2"),
        ((written(), "rad", ["1"]), "expected as many units, found 'rad'"),
        ((written(), ["rad"], ["parsec"]), "outputs of sine: .*parsec"),
        ((Callback(last=0), ["rad"], ["1"]), "numpy_0 has no derivatives"),
    ],
)
def test_wrong_declarations(arguments, sentence):
    with pytest.raises(ModelError, match=sentence):
        gt.external(*arguments)


def test_a_derivative_that_is_missing_later():
    """The rate of the value has the first derivative, Newton's method for it the second."""
    model = pendulum(gt.external(Callback(last=1), ["rad"], ["1"]))
    assert model().causal(known="phi", targets="h")(0.5)[0] == pytest.approx(np.sin(0.5), abs=ROUND_OFF)
    with pytest.raises(ModelError, match="'numpy_1' has no derivatives"):
        model().causal(known="phi", targets="der(h,2)")


def test_wrong_calls():
    sine = gt.external(written(), ["rad"], ["1"])
    m = gt.Builder()
    x, v = m.variable("x", unit="m"), m.variable("v", 2, unit="rad")
    for arguments, sentence in (
        ((x,), r"argument 'i0' of sine\(\) is in m; expected rad"),
        ((v,), r"argument 'i0' of sine\(\) has shape \(2,\); expected \(\)"),
        ((v[0], v[1]), r"sine\(\) takes 1 arguments; found 2"),
        ((0.5,), "needs at least one expression of the model"),
    ):
        with pytest.raises(ModelError, match=sentence) as error:
            sine(*arguments)
        assert "test_external.py" in str(error.value)
