"""One problem as one class, by extends and modification, and as a component: the same flat equations."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.modelica.printed import flat_text
from gtmodel.modelica.translate import translated

pytest.importorskip("lark")

# each: what stands in the whole class (and in what is extended, with other numbers), its header, and its constraints;
# {x} is x, or sys.x of the component
STATEMENTS = {
    "van der pol": (
        "parameter Real mu = {mu}; Real x1(start = 0, fixed = true); Real x2(start = {x2}, fixed = true); "
        "input Real u(max = {top});",
        "der(x1) = mu*(1 - x2^2)*x1 - x2 + u; der(x2) = x1;",
        {"mu": ("1.5", "mu = 1.5"), "x2": ("1", "x2(start = 1)"), "top": ("0.75", "u(max = 0.75)")},
        "objectiveIntegrand = {s}x1^2 + {s}x2^2 + {s}u^2, finalTime = 20", "{s}x1(finalTime) = 0;",
    ),
    "penicillin": (
        "parameter Real mu_m = {rate}; parameter Real half[2] = {{0.05, 5}}; "
        "Real X(start = 1, fixed = true, max = {top}); Real S(start = 0.5, fixed = true, min = 0); "
        "Real P(start = 0, fixed = true); Real V(start = 150, fixed = true); "
        "Real u(start = {feed}, fixed = true, min = 0); input Real du; Real mu;",
        "mu = mu_m*S/(half[1] + S + S^2/half[2]); der(X) = mu*X - u/V*X; der(P) = 0.004*X - u/V*P; der(V) = u; "
        "der(S) = -mu*X/0.5 - 0.004*X/1.2 + u/V*(200 - S); der(u) = du;",
        {"rate": ("0.02", "mu_m = 0.02"), "top": ("3.7", "X(max = 3.7)"), "feed": ("0.03", "u(start = 0.03)")},
        "objective = -{s}P(finalTime), finalTime = 75", "{s}du <= 0.1; {s}du >= -0.1;",
    ),
    "stirred tank": (
        "parameter Real V = {volume}; parameter Real E = 8750; parameter Real k0 = 7.2e10/60; "
        "parameter Real c0 = {feed}; "
        "parameter Real rate = 100/1000/60/V; Real c(start = 956.271065, fixed = true, nominal = c0); "
        "Real T(start = 250.051971, fixed = true, max = {top}); input Real Tc(min = 230, max = 370); "
        "Real k = k0*exp(-E/T);",
        "der(c) = rate*(c0 - c) - k*c; der(T) = rate*(350 - T) + 0.21*k*c + 0.035*(Tc - T);",
        {"volume": ("100", "V = 100"), "feed": ("1000", "c0 = 1000"), "top": ("350", "T(max = 350)")},
        "objectiveIntegrand = (338.775766 - {s}c)^2 + (280 - {s}Tc)^2, finalTime = 150", "",
    ),
    "chain of masses": (
        "parameter Integer n = {n}; Mass mass[n](m = {m}, each v(fixed = true)); Spring spring[n](each c = {c}); "
        "Wall wall; Pusher pusher; input Real push;",
        "connect(wall.a, spring[1].a); for i in 1:n loop connect(spring[i].b, mass[i].a); end for; "
        "for i in 1:n - 1 loop connect(mass[i].b, spring[i + 1].a); end for; "
        "connect(mass[n].b, pusher.a); pusher.f = push;",
        {"n": ("3", "n = 3"), "m": ("{1, 2, 3}", "mass(m = {1, 2, 3})"), "c": ("20", "spring(each c = 20)")},
        "objectiveIntegrand = {s}mass[3].s^2 + {s}push^2, finalTime = 2", "{s}mass[1].v(finalTime) = 0;",
    ),
    "functions and branches": (
        "parameter Boolean stiff = {stiff}; parameter Real a[:] = {a}; Real x[2](start = {start}, each fixed = true); "
        "input Real u; Real load;",
        "load = horner(a, x[1]); if stiff then der(x[1]) = 10*(x[2] - x[1]); else der(x[1]) = x[2]; end if; "
        "der(x[2]) = -load + (if noEvent(x[1] > 0) then u*x[2] else 2*u*x[2]);",
        {"stiff": ("true", "stiff = true"), "a": ("{1, 2, 0.5}", "a = {1, 2, 0.5}"),
         "start": ("{1, -1}", "x(start = {1, -1})")},
        "objectiveIntegrand = {s}x*{s}x + {s}u^2, finalTime = 1", "",
    ),
}  # fmt: skip
PARTS = """
connector Flange Real s; flow Real f; end Flange;
model Mass parameter Real m = 1; Flange a; Flange b; Real v(start = 0); Real s(start = 0, fixed = true);
equation a.s = s; b.s = s; der(s) = v; m*der(v) = a.f + b.f; end Mass;
model Spring parameter Real c = 10; Flange a; Flange b; equation a.f = c*(a.s - b.s); a.f + b.f = 0; end Spring;
model Wall Flange a; equation a.s = 0; end Wall;
model Pusher Flange a; Real f; equation a.f = -f; end Pusher;
function horner input Real a[:]; input Real x; output Real y;
algorithm y := 0; for i in 1:size(a, 1) loop y := y*x + a[i]; end for; end horner;
"""
OTHER = {"n": "2", "m": "fill(7, n)", "a": "{4}", "start": "{0, 0}", "stiff": "false"}
# one attribute more, in the component alone
MORE = {
    "van der pol": "x1(max = 9)", "penicillin": "half = {0.06, 5}", "stirred tank": "E = 8751",
    "chain of masses": "wall.a.f(nominal = 3)", "functions and branches": "load(start = 1)",
}  # fmt: skip
POINTS = 100


def text_of(name: str) -> str:
    elements, equations, values, header, constraint = STATEMENTS[name]
    here = elements.format(**{k: v for k, (v, _) in values.items()})
    there = elements.format(**{k: OTHER.get(k, "99") for k in values})
    said = ", ".join(m for _, m in values.values())

    def statement(package: str, body: str, before: str) -> str:
        ending = f"constraint {constraint.format(s=before)}" if constraint else ""
        head = f"package {package} optimization P({header.format(s=before)})"
        return f"{head} {body} {ending} end P; end {package};\n"

    return (
        f"{PARTS} model Base {there} equation {equations} end Base;\n"
        + statement("Whole", f"{here} equation {equations}", "")
        + statement("Extended", f"extends Base({said});", "")
        + statement("Part", f"Base sys({said});", "sys.")
    )


def bare(name: str) -> str:
    return name.replace("sys.", "")


def residuals(reference: str) -> np.ndarray:
    """Of all equations at POINTS drawn values of every variable, derivative and parameter, by their names."""
    flat = flat_of(gt.modelica.load(reference)())
    column = ca.vertcat(*[e.residual for e in flat.equations])
    symbols = sorted(ca.symvar(column), key=lambda x: bare(x.name()))
    drawn = np.random.default_rng(28).uniform(0.5, 2.0, (len(symbols), POINTS))
    return np.array(ca.Function("f", [ca.vertcat(*symbols)], [column])(drawn))


@pytest.mark.parametrize("name", STATEMENTS)
def test_three_formulations_have_the_same_flat_equations(tmp_path: Path, name: str) -> None:
    file = tmp_path / "statement.mop"
    file.write_text(text_of(name))
    texts = [flat_text(translated(f"{file}:{way}.P").flat, bare) for way in ("Whole", "Extended", "Part")]
    assert texts[0] == texts[1] and texts[0] == texts[2]
    assert texts[0].count(" = ") > 6
    numbers = [residuals(f"{file}:{way}.P") for way in ("Whole", "Extended", "Part")]
    assert numbers[0].shape[1] == POINTS and np.all(np.isfinite(numbers[0])) and np.ptp(numbers[0], axis=1).min() > 0
    assert np.array_equal(numbers[0], numbers[1]) and np.array_equal(numbers[0], numbers[2])
    file.write_text(file.read_text().replace("Base sys(", f"Base sys({MORE[name]}, "))
    assert flat_text(translated(f"{file}:Part.P").flat, bare) != texts[0]  # the text sees every attribute


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("chain of masses", {"sys.mass[2].s", "sys.mass[3].b.f", "sys.spring[1].a.s", "sys.push"}),
        ("functions and branches", {"sys.x[1]", "sys.x[2]", "sys.load"}),
    ],
)
def test_names_of_results_are_those_of_the_text(tmp_path: Path, name: str, wanted: set[str]) -> None:
    file = tmp_path / "statement.mop"
    file.write_text(text_of(name))
    solution = gt.solve(gt.modelica.load(f"{file}:Part.P")(), gt.Mesh(3), throw=False)
    assert all(np.all(np.isfinite(solution.trajectory[name])) for name in wanted)


@pytest.mark.parametrize("name", STATEMENTS)
def test_a_flat_text_reads_back_as_itself(tmp_path: Path, name: str) -> None:
    file, flat = tmp_path / "statement.mop", tmp_path / "flat.mop"
    file.write_text(text_of(name))
    flat.write_text(gt.modelica.flat_of_text(f"{file}:Part.P"))
    assert gt.modelica.flat_of_text(flat) == flat.read_text()
    assert np.array_equal(residuals(str(flat)), residuals(f"{file}:Part.P"))


EVENTS = """model M Real h(start = 1, fixed = true); Real v; discrete Real n(start = 0); equation
  der(h) = v; der(v) = -9.81; assert(v > -20, "too \\"fast\\"");
  when h <= 0 and v < 0 then reinit(v, -0.5*v); n = pre(n) + 1;
  elsewhen h > 9 then terminate("away"); end when; end M;"""


def test_events_read_back_too(tmp_path: Path) -> None:
    file, flat = tmp_path / "events.mo", tmp_path / "flat.mo"
    file.write_text(EVENTS)
    flat.write_text(gt.modelica.flat_of_text(file))
    assert gt.modelica.flat_of_text(flat) == flat.read_text() and "elsewhen" in flat.read_text()
    ours, again = (gt.modelica.load(f)().simulate(0.9) for f in (file, flat))
    assert [e.time for e in again.events] == [e.time for e in ours.events] != []
    file.write_text("model M Real x = time; Real y = mod(x, 0.3); end M;")
    flat.write_text(gt.modelica.flat_of_text(file))
    assert gt.modelica.flat_of_text(flat) == flat.read_text() and "mod(x, 0.3)" in flat.read_text()
