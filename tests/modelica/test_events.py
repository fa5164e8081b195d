"""Events of a text: the Modelica semantics of each construct, against results by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.modelica.translate import translated

pytest.importorskip("lark")

# x = t, in the models below
CLOCK = "Real x(start = 0, fixed = true); equation der(x) = 1;"
EXACT = 1e-9  # of motions that are linear between events: what an instant that is found by Newton leaves


def made(tmp_path: Path, text: str) -> Any:
    file = tmp_path / "m.mo"
    file.write_text(text)
    return translated(f"{file}:M").model()


def run(tmp_path: Path, text: str, end: float = 1.0, **options: Any) -> Any:
    return gt.simulate(made(tmp_path, text), end, **options)


def history(simulation: Any, name: str) -> list[tuple[float, float]]:
    """Instants, to a billionth, and new values of a discrete variable."""
    return [(round(e.time, 9), e.discrete[name][1]) for e in simulation.events if name in e.discrete]


def after(simulation: Any, name: str, times: np.ndarray) -> np.ndarray:
    """Values of a variable that is constant between events, at times that are none."""
    t, v = simulation.trajectory.time, simulation.trajectory[name]
    return np.array([v[np.searchsorted(t, one, side="right") - 1] for one in times])


def test_conditions_in_a_vector_act_independently_and_elsewhen_has_less_precedence(tmp_path: Path) -> None:
    text = f"""model M Integer n(start = 0); discrete Real y(start = 0); {CLOCK}
      when {{x > 0.5, x > 0.2}} then n = pre(n) + 1; y = x;
      elsewhen 2*x > 1 then n = 100;
      elsewhen x > 0.75 then n = pre(n) + 10;
      end when; end M;"""
    # at 0.5 the first clause acts, although x > 0.2 stays true; 2*x > 1 becomes true there too and has had its moment
    simulation = run(tmp_path, text)
    assert history(simulation, "n") == [(0.2, 1), (0.5, 2), (0.75, 12)]
    assert simulation.trajectory["y"][-1] == pytest.approx(0.5, abs=1e-12)


def test_dependent_events_of_one_instant_are_in_order(tmp_path: Path) -> None:
    """A counter that starts anew: the branch of pre(n) acts in the next round of the same event."""
    text = f"""model M Integer n(start = 0); Integer laps(start = 0); {CLOCK}
      when sample(0.1, 0.1) then n = pre(n) + 1; elsewhen pre(n) >= 3 then n = 0; end when;
      when n >= 3 then laps = pre(laps) + 1; end when; end M;"""
    simulation = run(tmp_path, text, 0.95)
    assert simulation.trajectory["laps"][-1] == 3 and simulation.trajectory["n"][-1] == 0


def test_a_sampled_controller_agrees_with_the_matrix_exponential(tmp_path: Path) -> None:
    text = """model M parameter Real T = 0.2; parameter Real k = 1.5; Real y(start = 1, fixed = true);
      discrete Real u(start = 0); discrete Real sum(start = 0);
      equation der(y) = -y + u;
      when {initial(), sample(T, T)} then sum = pre(sum) + y; u = -k*y - 0.1*sum; end when; end M;"""
    simulation = run(tmp_path, text, 2.1)
    y, u, total, a = 1.0, 0.0, 0.0, float(np.exp(-0.2))
    for k in range(11):
        total += y
        u = -1.5 * y - 0.1 * total
        span = 0.2 if k < 10 else 0.1
        y = np.exp(-span) * y + (1 - np.exp(-span)) * u if k == 10 else a * y + (1 - a) * u
    assert simulation.trajectory["y"][-1] == pytest.approx(y, abs=1e-8)
    assert simulation.trajectory["u"][-1] == pytest.approx(u, abs=1e-8)


def test_blocks_that_sample_together_read_new_values_through_their_connections(tmp_path: Path) -> None:
    text = """
    connector In = input Real; connector Out = output Real;
    block Counter Out y(start = 0); equation when sample(0, 0.1) then y = pre(y) + 1; end when; end Counter;
    block Twice In u; Out y(start = 0); equation when sample(0, 0.1) then y = 2*u; end when; end Twice;
    model M Counter a; Twice b; Real held; equation held = a.y + 3; connect(a.y, b.u); end M;"""
    simulation = run(tmp_path, text, 0.55)
    assert np.all(after(simulation, "b.y", np.arange(0.05, 0.5, 0.1)) == 2 * np.arange(1, 6))
    assert simulation.trajectory["held"][-1] == 9.0


def test_a_relay_with_hysteresis_switches_by_its_own_memory(tmp_path: Path) -> None:
    text = """model M Real x(start = 0, fixed = true); Boolean on(start = true); Integer times(start = 0);
      equation der(x) = if on then 1 else -1;
      on = not pre(on) and x < 0.2 or pre(on) and x <= 0.6;
      when edge(on) then times = pre(times) + 1; end when; end M;"""
    simulation = run(tmp_path, text, 2.9)
    assert history(simulation, "on") == [(0.6, 0), (1.0, 1), (1.4, 0), (1.8, 1), (2.2, 0), (2.6, 1)]
    assert simulation.trajectory["times"][-1] == 3
    assert simulation.trajectory["x"][-1] == pytest.approx(0.5, abs=1e-9)
    # what is true at the start is no edge; a start beyond the threshold switches at once
    assert history(run(tmp_path, text, 0.3, start={"x": 0.7}), "on") == [(0.0, 0)]


def test_change_and_edge_of_a_condition(tmp_path: Path) -> None:
    text = """model M Boolean b = sin(6.283185307179586*time) > 0.5; Integer n(start = 0); Integer up(start = 0);
      equation when change(b) then n = pre(n) + 1; end when;
      when b and not pre(b) then up = pre(up) + 1; end when; end M;"""
    simulation = run(tmp_path, text, 2.0)  # above 0.5 from 1/12 to 5/12 of each second
    assert [round(t * 12, 6) for t, _ in history(simulation, "n")] == [1.0, 5.0, 13.0, 17.0]
    assert [round(t * 12, 6) for t, _ in history(simulation, "up")] == [1.0, 13.0]


def test_integer_functions_jump_at_the_exact_time(tmp_path: Path) -> None:
    text = """model M Real f = floor(2*time - 0.7); Integer k = integer(3*time) + 1; Real m = mod(time, 0.3);
      Real c = ceil(-2.5*time); Real d = div(0.35 - time, 0.25); Real r = rem(0.35 - time, 0.25);
      Real s = floor(3*sin(6*time)); end M;"""
    simulation = run(tmp_path, text)
    t = np.arange(0.0131, 1.0, 0.0437)
    expected = {
        "f": np.floor(2 * t - 0.7), "k": np.floor(3 * t) + 1, "c": np.ceil(-2.5 * t),
        "d": np.trunc((0.35 - t) / 0.25), "s": np.floor(3 * np.sin(6 * t)),
    }  # fmt: skip
    for name, values in expected.items():
        assert np.array_equal(after(simulation, name, t), values), name
    rows = simulation.trajectory
    inside = np.min(np.abs(rows.time[:, None] - np.arange(0, 5) * 0.3), axis=1) > 1e-9
    assert np.allclose(rows["m"][inside], np.mod(rows.time, 0.3)[inside], rtol=0, atol=1e-12)
    inside = np.min(np.abs(rows.time[:, None] - np.array([0.1, 0.6, 0.85])), axis=1) > 1e-9
    assert np.allclose(rows["r"][inside], np.fmod(0.35 - rows.time, 0.25)[inside], rtol=0, atol=1e-12)


def test_integer_functions_in_actions_use_values_at_the_instant(tmp_path: Path) -> None:
    text = f"""model M Integer n(start = 0); Real parity(start = 0); Boolean odd(start = false);
      Integer third(start = 0); {CLOCK}
      when sample(0.1, 0.1) then n = pre(n) + 1; parity = mod(n, 2); odd = n <> 2 and mod(n, 2) == 1;
        third = div(n, 3) + integer(n/3) + (if n >= 4 and not pre(odd) then 10 else 0); end when; end M;"""
    simulation = run(tmp_path, text, 0.55)
    assert history(simulation, "parity") == [(0.1, 1), (0.2, 0), (0.3, 1), (0.4, 0), (0.5, 1)]
    assert history(simulation, "odd") == [(0.1, 1), (0.2, 0), (0.3, 1), (0.4, 0), (0.5, 1)]
    assert history(simulation, "third") == [(0.3, 2), (0.5, 12)]


def test_an_if_expression_in_an_action_uses_the_condition_at_the_instant(tmp_path: Path) -> None:
    text = f"""model M Integer side(start = 0); {CLOCK}
      when {{x > 0.25, x > 0.5}} then side = if x >= 0.5 then 2 else 1; end when; end M;"""
    assert history(run(tmp_path, text), "side") == [(0.25, 1), (0.5, 2)]


def test_states_of_an_enumeration(tmp_path: Path) -> None:
    text = """model M type Mode = enumeration(idle, up, down); Mode mode(start = Mode.idle);
      Real x(start = 0, fixed = true);
      equation der(x) = if mode == Mode.up then 2 elseif mode == Mode.down then -1 else 0;
      when time > 0.5 then mode = Mode.up;
      elsewhen x > 1 and pre(mode) == Mode.up then mode = Mode.down;
      elsewhen x < 0.4 and pre(mode) == Mode.down then mode = Mode.idle;
      end when; end M;"""
    simulation = run(tmp_path, text, 3.0)
    assert history(simulation, "mode") == [(0.5, 2), (1.0, 3), (1.6, 1)]
    assert simulation.trajectory["x"][-1] == pytest.approx(0.4, abs=1e-9)


def test_when_statements_read_previous_values(tmp_path: Path) -> None:
    text = f"""model M Integer n(start = 0); Real y[2](start = {{0, 0}}); Boolean big(start = false);
      {CLOCK}
      algorithm
      when sample(0.1, 0.1) then
        n := n + 1;
        if n > 2 then y[1] := y[1] + n; else y[2] := y[2] + 1; end if;
        big := y[1] > 6;
      elsewhen x > 0.45 then
        n := 0;
      end when; end M;"""
    simulation = run(tmp_path, text, 0.95)
    # 1, 2 | 3, 4 | 0 at 0.45 | 1, 2 | 3, 4, 5
    assert simulation.trajectory["n"][-1] == 5
    assert simulation.trajectory["y[1]"][-1] == 3 + 4 + 3 + 4 + 5 and simulation.trajectory["y[2]"][-1] == 4
    assert history(simulation, "big") == [(0.4, 1)]


def test_a_run_ends_by_terminate_and_by_assert(tmp_path: Path) -> None:
    simulation = run(tmp_path, f'model M {CLOCK} when x >= 0.5 then terminate("half of it"); end when; end M;')
    assert simulation.status is gt.SolveStatus.SOLVED and "half of it" in simulation.message
    assert simulation.trajectory.time[-1] == pytest.approx(0.5, abs=1e-12)
    late = f'model M {CLOCK} assert(x <= 0.7, "x is too large"); end M;'
    failed = run(tmp_path, late, throw=False)
    assert failed.status is gt.SolveStatus.FAILED and "x is too large" in failed.message and "m.mo:1" in failed.message
    assert failed.trajectory.time[-1] == pytest.approx(0.7, abs=1e-12)
    at_once = run(tmp_path, late, start={"x": 0.8}, throw=False)
    assert at_once.status is gt.SolveStatus.FAILED and at_once.trajectory.time[-1] < 1e-9
    warned = f'model M {CLOCK} assert(x <= 0.7, "hm", AssertionLevel.warning); end M;'
    assert run(tmp_path, warned).status.ok
    assert "level warning" in translated(f"{tmp_path / 'm.mo'}:M").warnings[0]


def test_starts_of_discrete_variables(tmp_path: Path) -> None:
    text = f"""model M Integer n; discrete Real y(start = 7); Boolean b; {CLOCK}
      b = x > 0.5 or pre(b);
      when x > 0.25 then n = pre(n) + 1; y = pre(y) + n; end when;
      initial equation n = 4; pre(b) = false; end M;"""
    simulation = run(tmp_path, text)
    assert history(simulation, "n") == [(0.25, 5)] and history(simulation, "y") == [(0.25, 12)]
    assert history(simulation, "b") == [(0.5, 1)]


def test_initial_with_other_conditions_is_true_only_at_the_start(tmp_path: Path) -> None:
    """A brake that slides at the start, as the standard library's frictions say it: 1 - 2 t until it rests."""
    text = """model M Real w(start = 1, fixed = true); Boolean forward(start = false, fixed = true);
      Integer mode(start = 3, fixed = true); Boolean first = initial() and w > 0; equation
      forward = first or pre(forward) and w > 0; mode = if first then 1 else pre(mode);
      der(w) = if forward then -2 else 0; end M;"""
    simulation = run(tmp_path, text)
    time, w = simulation.trajectory.time, simulation.trajectory["w"]
    assert np.interp([0.25, 1.0], time, w) == pytest.approx([0.5, 0.0], abs=EXACT)
    assert simulation.trajectory["mode"][-1] == 1


def test_a_variable_that_is_zero_before_an_event_can_be_a_denominator_after_it(tmp_path: Path) -> None:
    """The library's point-to-point source: s is 0 before the event, and another name of m after it."""
    text = """model M parameter Real q = 2; Real aux, m, T, s, x(start = 0, fixed = true); equation
      aux = q; m = 1/aux; T = sqrt(1/m); s = if time < 0.5 then 0 else if time < T then m else 0; der(x) = s; end M;"""
    assert run(tmp_path, text).trajectory["x"][-1] == pytest.approx(0.25, abs=EXACT)


REFUSED = {
    "its own condition reads it": ("when n >= 3 then n = 0; end when;", "pre"),
    "pre of what made it true": (
        "when x > 0.5 then n = 1; end when; when n >= 1 then k = pre(n); end when;", "one when clause"),
    "late precedence": (
        "when x > 0.5 then n = 1; end when; when n >= 1 then k = 1; elsewhen x > 0.5 then k = 2; end when;",
        "precedence"),
    "read a round too early": (
        "when x > 0.5 then n = 1; end when; when n >= 1 then k = 1; end when;"
        " when x > 0.5 then y = k; end when;", "same instant"),
    "two clauses": ("when x > 0.5 then n = 1; n = 2; end when;", "two values"),
    "initial among others": ("when initial() and x > 0.5 then n = 1; end when;", "alone"),
    "edge among others": ("when edge(b) and x > 0.5 then n = 1; end when;", "edge"),
    "change of a number": ("when change(n) then k = 1; end when;", "Boolean"),
    "equality of reals": ("when x == 0.5 then n = 1; end when;", "=="),
    "the end": ("when terminal() then n = 1; end when;", "terminal"),
    "a parameter": ("when x > 0.5 then p = 1; end when;", "parameter"),
    "terminate alone": ('terminate("now");', "when clause"),
    "an algebraic loop": ("when x > 0.5 then y = -z; end when; z + exp(z) = y;", "equation z ="),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_unsupported_events_are_rejected_with_their_line(tmp_path: Path, case: str) -> None:
    clause, word = REFUSED[case]
    more = "Real z(start = 0);" if "z" in clause else ""
    declared = {"n": "Integer n(start = 0);", "k": "Integer k(start = 0);", "y": "discrete Real y(start = 0);"}
    used = [d for name, d in declared.items() if f"{name} =" in clause or f"({name})" in clause]
    text = f"model M\n{' '.join(used)} {more} parameter Real p = 2; Boolean b = x > 0.1; {CLOCK}\n{clause}\nend M;"
    with pytest.raises(gt.ModelError, match=r"m\.mo:3") as caught:
        run(tmp_path, text)
    assert word in str(caught.value)


def test_flat_text_of_events_reads_back(tmp_path: Path) -> None:
    text = """model M Real x(start = 0, fixed = true); Boolean on(start = true); Integer times(start = 0);
      equation der(x) = if on then 1 else -floor(1 + time/10);
      on = not pre(on) and x < 0.2 or pre(on) and x <= 0.6;
      assert(x < 5, "far");
      when edge(on) then times = pre(times) + 1; elsewhen {sample(0.5, 1), x > 1} then times = -1; end when; end M;"""
    simulation = run(tmp_path, text, 2.0)
    flat = tmp_path / "flat.mo"
    flat.write_text(gt.modelica.flat_of_text(tmp_path / "m.mo"))
    assert gt.modelica.flat_of_text(flat) == flat.read_text()
    again = gt.simulate(gt.modelica.load(flat)(), 2.0)
    assert history(again, "times") == history(simulation, "times") == [(0.5, -1), (1.0, 0), (1.5, -1), (1.8, 0)]
    namespace: dict[str, Any] = {}
    exec(gt.modelica.python_of(tmp_path / "m.mo"), namespace)
    assert history(gt.simulate(namespace["M"](), 2.0), "on") == history(simulation, "on")


def test_an_output_that_switches_between_states_jumps_but_the_states_continue(tmp_path: Path) -> None:
    text = """model M Real a(start = 0, fixed = true); Real b(start = 3, fixed = true); Real y; Real z; output Real w;
      equation der(a) = 1; der(b) = -b; y = if a > 1 then b else a;
      if a > 1 then z = -a; else z = b; end if;
      w = if b > 1 then y else -z; end M;"""
    simulation = run(tmp_path, text, 2.0, step=0.25)
    first, second = (e.time for e in simulation.events)
    assert [first, second] == pytest.approx([1.0, np.log(3)], abs=1e-8)
    t = simulation.trajectory.time
    b = 3 * np.exp(-t)
    y, z = np.where(t > first, b, t), np.where(t > first, -t, b)
    for name, exact in (("y", y), ("z", z), ("w", np.where(t > second, -z, y)), ("b", b)):
        np.testing.assert_allclose(simulation.trajectory[name], exact, atol=1e-8)


def test_internal_variables_of_events_are_not_results(tmp_path: Path) -> None:
    """initial(), floor() and pre() of an Integer make variables that only a person who asks for them sees."""
    text = """model M Real x(start = 1, fixed = true); Integer mode(start = 0, fixed = true); Boolean b; equation
      der(x) = -floor(x + time); b = initial() and x > 0.5; mode = if b then 3 else pre(mode); end M;"""
    model = made(tmp_path, text)
    simulation = gt.simulate(model, 0.1)
    assert set(simulation.trajectory.names) == {"x", "der(x)", "mode"}
    assert {name for e in simulation.events for name in e.discrete} == set()
    asked = gt.simulate(model, 0.1, outputs=["pre(mode)", "initial()"]).trajectory
    assert (asked["pre(mode)"][-1], asked["initial()"][-1]) == (3, 0)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("model M Real x(start = 1, fixed = true); Real y;\nequation der(x) = -1; y = 2*x;\n"
         "when x < 0.5 then\nreinit(y, 1); end when; end M;", 3),
        ("model M parameter Real c = 0;\nReal x(start = 1, fixed = true); equation\n\nder(x) = -x/c; end M;", 4),
    ],
    ids=["reinit", "division by zero"],
)  # fmt: skip
def test_errors_of_a_simulation_name_the_line_of_the_clause(tmp_path: Path, text: str, line: int) -> None:
    with pytest.raises(gt.ModelError) as caught:
        run(tmp_path, text)
    assert caught.value.where is not None
    assert caught.value.where.line == line
