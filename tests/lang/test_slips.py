"""What people mistype in a model: each slip is an error of its kind, at the line where it was written."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.lang.slips import CallError

SYMBOL = ca.SX.sym("x")
FUNCTION = ca.Function("square", [SYMBOL], [SYMBOL**2])


class Pendulum(gt.Model):
    length = gt.parameter(1.0)
    q = gt.variable()
    tau = gt.input()

    def equations(self) -> Any:
        yield self.length * gt.der(gt.der(self.q)) == self.tau - 9.81 * gt.sin(self.q)


class Joint(gt.Connector):
    phi = gt.potential()
    tau = gt.flow()


class Disc(gt.Model):
    a = gt.port(Joint)
    b = gt.port(Joint)

    def equations(self) -> Any:
        yield self.a.phi == self.b.phi
        yield gt.der(gt.der(self.a.phi)) == self.a.tau + self.b.tau


class Chain(gt.Model):
    first = gt.part(Disc)
    second = gt.part(Disc)
    tau = gt.input()

    def equations(self) -> Any:
        yield gt.connect(self.first.b, self.second.a)
        yield self.first.a.tau == self.tau


def model_with(line: Any) -> gt.Model:
    """A pendulum whose equations end with what a person mistyped."""

    class Mistyped(Pendulum):
        def equations(self) -> Any:
            yield from super().equations()
            yield line(self)

    return Mistyped()


IN_EQUATIONS = {
    "a name that gt lacks": (lambda m: gt.vertcat(m.q, 1), "vertcat"),
    "a misspelt name of gt": (lambda m: gt.sinn(m.q) == 0, "'sin'"),
    "a function of math": (lambda m: math.sin(m.q) == 0, "gt.sin"),
    "float of an expression": (lambda m: float(m.q) == 0, "gt"),
    "an expression as an index": (lambda m: [1, 2][m.q] == 0, "gt"),
    "round": (lambda m: int(m.q) == 0, "gt"),
    "an instant": (lambda m: m.q.at(1.0) == 0, "constraints"),
    "an undeclared name": (lambda m: m.qq == 0, "'q'"),
    "three ports": (lambda m: gt.connect(m.q, m.q, m.q), "connect"),
    "a CasADi function": (lambda m: FUNCTION(m.q) == 0, "CasADi"),
    "a sine of CasADi": (lambda m: ca.sin(m.q) == 0, "gt.sin"),
    "a division by zero": (lambda m: m.q == 1 / 0, "ZeroDivisionError"),
    "a length of a scalar": (lambda m: m.q == len(m.q), "length"),
    "an unknown option": (lambda m: gt.der(m.q, oder=2) == 0, "oder"),
}


@pytest.mark.parametrize("line", IN_EQUATIONS)
def test_a_slip_in_equations_names_its_line(line: str) -> None:
    mistyped, word = IN_EQUATIONS[line]
    with pytest.raises(gt.ModelError) as caught:
        model_with(mistyped).causal(known=["q"], targets=["tau"])
    assert word in str(caught.value)
    where = caught.value.where
    assert where is not None and where.file == "lang/test_slips.py" and where.line == mistyped.__code__.co_firstlineno


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        (["der(q,2)"], r"inputs that are known: known=\['tau', 'wind'\]"),
        (["tau"], r"inputs that are known: known=\['wind'\]"),
        (["tau", "wind"], ""),
    ],
)
def test_inputs_that_are_not_given_are_named_but_for_those_that_are_asked_for(targets: list[str], said: str) -> None:
    class Blown(gt.Model):
        q = gt.variable()
        tau = gt.input()
        wind = gt.input()

        def equations(self) -> Any:
            yield gt.der(self.q, 2) == self.tau + self.wind

    with pytest.raises(gt.ModelError, match=said or r"known variables\) \(") as caught:
        Blown().causal(targets=targets)
    assert said or "to be named" not in str(caught.value)


CALLS = {
    "know": (lambda: Pendulum().causal(know="q", targets="tau"), "'known'"),
    "class": (lambda: Pendulum.causal(known="q", targets="tau"), "()"),
    "surplus": (lambda: gt.connect(1, 2, 3), "connect"),
    "option of a variable": (lambda: gt.variable(units="m"), "'unit'"),
    "option of a parameter": (lambda: gt.parameter(1.0, minimum=2), "minimum"),
    "option of simulate": (lambda: Pendulum().simulate(1.0, input={"tau": 0}), "'inputs'"),
    "missing": (lambda: gt.port(), "cls"),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_call_with_wrong_arguments_names_the_callers_line(call: str) -> None:
    wrong, word = CALLS[call]
    with pytest.raises(CallError) as caught:
        wrong()
    assert word in str(caught.value) and caught.value.where is not None
    assert caught.value.where.file == "lang/test_slips.py"
    assert isinstance(caught.value, TypeError)


def test_a_type_error_inside_a_called_function_is_its_own() -> None:
    class Odd(Pendulum):
        def equations(self) -> Any:
            yield self.q == np.array(["a"]) @ np.array([1.0])

    with pytest.raises(gt.ModelError) as caught:
        Odd().causal(known="q", targets="tau")
    assert not isinstance(caught.value, CallError)


def test_a_misspelt_name_of_the_package_is_near_one_that_is_there() -> None:
    with pytest.raises(AttributeError, match="'variable'"):
        gt.varaible  # noqa: B018


def test_parts_takes_the_count_first() -> None:
    with pytest.raises(gt.ModelError, match="count first"):
        gt.parts(Pendulum, 3)


def test_a_port_that_is_connected_to_nothing_is_named() -> None:
    with pytest.raises(gt.ModelError) as caught:
        Chain().causal(known=["tau"], targets=["der(first.a.phi,2)"])
    assert "first.a" in str(caught.value).partition("unconnected")[2]


def test_an_ode_without_known_inputs_names_them() -> None:
    with pytest.raises(gt.ModelError, match=r"known=\['tau'\]"):
        Pendulum().causal(targets=["der(q,2)"])


def test_what_is_preferred_and_no_state_is_told() -> None:
    assert any("'q'" in note for note in Pendulum().causal(known="q", targets="tau", prefer="q").notes)
    assert not Pendulum().causal(known="tau", targets="der(q,2)", prefer="q").notes


def test_a_text_is_no_number_for_a_function() -> None:
    inverse = Pendulum().causal(known="q", targets="tau")
    with pytest.raises(TypeError, match="'abc'"):
        inverse("abc", 0.0, 0.0)


def test_a_correct_part_of_equations_goes_on_working_with_arrays() -> None:
    class Pair(gt.Model):
        x = gt.variable(2)
        u = gt.input(2)

        def equations(self) -> Any:
            yield np.array([[1.0, 2.0], [0.0, 1.0]]) @ self.x == self.u

    values, status = Pair().causal(known="u", targets="x")(np.array([1.0, 1.0]))
    assert status is gt.Status.OK and np.allclose(values, [-1.0, 1.0])


def test_a_folder_beside_the_package_whose_name_begins_like_it_is_a_persons() -> None:
    path = f"{Path(gt.__file__).parent}_robots/mine.py"  # never written: a name for the code
    space: dict[str, Any] = {"Pendulum": Pendulum}
    exec(compile("def asked():\n    return Pendulum().causal(known='nothing', targets='tau')\n", path, "exec"), space)
    with pytest.raises(gt.ModelError) as caught:
        space["asked"]()
    assert caught.value.where is not None and (caught.value.where.file, caught.value.where.line) == (
        "gtmodel_robots/mine.py",
        2,
    )


class Loose(Pendulum):
    """Without its third line it would be right as well: nothing but the missing yield shows that it is meant."""

    speed = gt.variable()

    def equations(self) -> Any:
        yield from super().equations()
        yield self.speed == gt.der(self.q)
        self.tau == -2.0 * self.speed  # noqa: B015


class Backward(Pendulum):
    def equations(self) -> Any:
        yield from super().equations()
        np.zeros(1) >= self.tau  # noqa: B015


class Started(Pendulum):
    def initial_equations(self) -> Any:
        0.1 == self.q  # noqa: B015
        yield gt.der(self.q) == 0.0


class TestAnEquationWithoutItsYield:
    @pytest.mark.parametrize(
        ("model", "method", "line"),
        [(Loose, "equations", 3), (Backward, "equations", 2), (Started, "initial_equations", 1)],
    )
    def test_is_named_with_its_line(self, model: type[gt.Model], method: str, line: int) -> None:
        with pytest.raises(gt.ModelError, match=r"the result of this '[=<>]=' is discarded; write yield") as caught:
            model().causal(known=["q"], targets=["tau"])
        first = getattr(model, method).__code__.co_firstlineno
        assert caught.value.where is not None
        assert (caught.value.where.file, caught.value.where.line - first) == ("lang/test_slips.py", line)

    def test_of_a_part_and_of_a_helper_is_named_too(self) -> None:
        class Helped(Pendulum):
            def equations(self) -> Any:
                yield from super().equations()
                self.stop()

            def stop(self) -> None:
                self.tau <= 1.0  # noqa: B015

        class Robot(gt.Model):
            arm = gt.part(Helped)

        with pytest.raises(gt.ModelError, match=r"write yield in front of it") as caught:
            Robot().causal(known=["arm.q"], targets=["arm.tau"])
        assert caught.value.where is not None
        assert caught.value.where.line == Helped.stop.__code__.co_firstlineno + 1

    def test_in_constraints_is_named_with_its_line(self) -> None:
        class Arrives(Move):
            def constraints(self) -> Any:
                yield self.x.at(self.final_time) == 0.0
                self.x <= 2.0  # noqa: B015

        with pytest.raises(gt.ModelError, match=r"this '<=' is discarded; write yield") as caught:
            gt.transcribe(Arrives(), gt.Mesh(2))
        assert caught.value.where is not None
        assert caught.value.where.line == Arrives.constraints.__code__.co_firstlineno + 2

    def test_outside_of_a_class_is_named_too(self) -> None:
        m = gt.Builder()
        x = m.variable("x")
        with pytest.raises(gt.ModelError, match=r"Builder\.add\(\)"):
            x == 1.0  # noqa: B015

    def test_that_has_a_name_which_nothing_reads_is_named_too(self) -> None:
        class Named(Pendulum):
            speed = gt.variable()

            def equations(self) -> Any:
                yield from super().equations()
                yield self.speed == gt.der(self.q)
                damping = self.tau == -2.0 * self.speed  # noqa: F841

        with pytest.raises(gt.ModelError, match=r"this '==' is assigned to 'damping', which is never read") as caught:
            Named().causal(known=["q"], targets=["tau"])
        assert caught.value.where is not None
        assert caught.value.where.line == Named.equations.__code__.co_firstlineno + 3

    def test_a_name_that_is_read_may_be_left_out(self) -> None:
        class Read(Pendulum):
            def equations(self) -> Any:
                yield from super().equations()
                first, second = self.tau == 0.0, self.tau == 1.0
                held, later, seen = self.tau == 2.0, [], self.tau == 3.0
                if later:
                    yield from (first, second)
                by_closure = self.tau == 4.0
                later.append(lambda: by_closure)
                repeated = None
                for k in range(3):
                    if repeated is not None:
                        later.append(repeated)
                    repeated = self.tau == float(k)
                _ = self.tau == 5.0
                repr((held, seen))

        assert Read().causal(known=["q"], targets=["tau"]) is not None

    def test_a_name_that_locals_may_read_may_be_left_out(self) -> None:
        class Seen(Pendulum):
            def equations(self) -> Any:
                yield from super().equations()
                stop = self.tau == 0.0
                assert "stop" in locals()

        assert Seen().causal(known=["q"], targets=["tau"]) is not None

    def test_a_name_of_a_module_may_be_left_out(self) -> None:
        names: dict[str, Any] = {"x": gt.Builder().variable("x")}
        exec("e = x == 1.0", names)
        assert names["e"].op == "=="

    def test_what_is_kept_may_be_left_out(self) -> None:
        class Chosen(Pendulum):
            def equations(self) -> Any:
                yield from (item for item in super().equations())
                stops = {"low": self.tau == 0.0, "high": self.tau == 1.0}
                assert stops.keys() == {"low", "high"}
                repr(self.tau <= 1.0)

        assert Chosen().causal(known=["q"], targets=["tau"]) is not None


class Move(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)

    def equations(self) -> Any:
        yield gt.der(self.x) == self.u

    def objective(self) -> Any:
        return gt.integral(self.u**2)


class TestSlipsOfOptimica:
    def test_a_section_called_constraint_is_not_left_out_in_silence(self) -> None:
        class Arrives(Move):
            def constraint(self) -> Any:
                yield self.x.at(self.final_time) == 0.0

        with pytest.raises(gt.ModelError, match=r"constraint\(\) is never called; rename it to constraints"):
            gt.transcribe(Arrives(), gt.Mesh(2))

    def test_a_helper_of_that_name_is_free(self) -> None:
        class Arrives(Move):
            def constraint(self) -> Any:
                return self.x.at(self.final_time) == 0.0

            def constraints(self) -> Any:
                yield self.constraint()

        assert gt.solve(Arrives(), gt.Mesh(2)).objective == pytest.approx(1.0)

    def test_a_variable_called_at_an_instant(self) -> None:
        class Arrives(Move):
            def constraints(self) -> Any:
                yield self.x(self.final_time) == 0.0

        with pytest.raises(gt.ModelError, match=r"write x\.at\(instant\)"):
            gt.transcribe(Arrives(), gt.Mesh(2))
