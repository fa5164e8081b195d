# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # One system, many causalities
#
# **How much can one set of equations answer?**
#
# A robot's equations say what belongs together: cart positions, plate, velocities, forces. They do not say what is
# given and what is asked. Textbooks solve them once for each question, by hand: forward kinematics, inverse
# kinematics, Jacobian, inverse dynamics, forward dynamics. Here the equations of the L1 prototype are written once,
# and every question is one line. After each answer stands how it was found (`explain`), and an `assert` that checks
# it in another way.

# %%
# %matplotlib inline
import control
import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt
from gtmodel.problem_files import run
from gtmodel.problem_files.load import load

robot = gt.robots.gantry_tau("l1_tape")
rng = np.random.default_rng(3)
n = 200
T = np.array([0.5, -0.8, 0.4]) + rng.uniform(-0.3, 0.3, (n, 3))
Td, Tdd = rng.uniform(-1, 1, (n, 3)), rng.uniform(-5, 5, (n, 3))


def excerpt(function):
    """The head of the certificate, and every block that is more than an assignment."""
    lines = function.explain().splitlines()
    blocks = [line for line in lines[3:] if "unknowns:" in line or "root of" in line]
    shown = [*lines[:3], *(line for line in lines[3:4] if "blocks:" in line), *blocks]
    return "\n".join(line if len(line) <= 118 else f"{line[:114]} ..." for line in shown)


def all_solved(status):
    return bool(np.all(np.asarray(status) == gt.Status.OK))


# %% [markdown]
# ## 1 Kinematics: which way round?
#
# Known carts, wanted plate: three spheres meet. The compiler finds the closed form itself, and the robot's own
# geometry says which of the two points is meant: `plate_ahead`.

# %%
forward = robot.causal(known="q", targets="T")
print(excerpt(forward))

# %% [markdown]
# Known plate, wanted carts: each rod by itself is a quadratic. Same equations, nothing rewritten.

# %%
inverse = robot.causal(known="T", targets="q")
print(excerpt(inverse))

q, status = inverse(T)
back, status_back = forward(q)
assert all_solved(status) and all_solved(status_back)
np.testing.assert_allclose(back, T, atol=1e-12)
links = T[:, None, :] - robot.A - q[:, :, None] * robot.v
np.testing.assert_allclose(np.linalg.norm(links, axis=2), np.broadcast_to(robot.L, (n, 3)), rtol=1e-13)

# %% [markdown]
# Nobody has to know all carts. Two carts and the height of the plate are three numbers as well. That is a question
# that no textbook answers. The compiler finds closed forms all the same: at a given height two spheres are two
# circles, and the third rod is a quadratic again. Where no closed form is left it would take Newton's method.

# %%
mixed = robot.causal(known=["q[0]", "q[1]", "T[2]"], targets=["T[0]", "T[1]", "q[2]"])
print(excerpt(mixed))
x, y, third, status = mixed(q[:, 0], q[:, 1], T[:, 2])
assert all_solved(status)
np.testing.assert_allclose(np.column_stack([x, y, third]), np.column_stack([T[:, 0], T[:, 1], q[:, 2]]), atol=1e-9)

# %% [markdown]
# ## 2 Velocities
#
# A derivative is asked for like anything else. The compiler differentiates the closure equations (the primes) and
# solves them: that is the Jacobian, without its matrix. By hand, a rod of constant length says
# $d_i\cdot(\dot T - \dot q_i v_i) = 0$.

# %%
velocity = robot.causal(known="q", targets="der(T)")
print(excerpt(velocity))

qd = np.einsum("nij,nj->ni", links, Td) / np.sum(links * robot.v, axis=2)
found, status = velocity(q, qd)
assert all_solved(status)
np.testing.assert_allclose(found, Td, atol=1e-11)

# %% [markdown]
# ## 3 Dynamics: which way round?
#
# Known motion, wanted motor forces. The head of the certificate says *index 3*: the closure equations have to be
# differentiated twice before accelerations appear. With the motion known there is nothing left to integrate: no
# degree of freedom.

# %%
inverse_dynamics = robot.causal(known="T", targets="tau")
print(excerpt(inverse_dynamics))

# %% [markdown]
# Known forces, wanted accelerations. Now six numbers may be chosen freely, three positions and three velocities: the
# states. `prefer` says whether those of the plate or those of the carts.

# %%
forward_dynamics = {name: robot.causal(known="tau", targets="der(T,2)", prefer=name) for name in ("T", "q")}
for function in forward_dynamics.values():
    print(excerpt(function), "\n")

tau, status = inverse_dynamics(T, Td, Tdd)
assert all_solved(status)
for name, states in (("T", (T, Td)), ("q", (q, qd))):
    found, status = forward_dynamics[name](*states, tau)
    assert all_solved(status)
    np.testing.assert_allclose(found, Tdd, atol=1e-9)

# %% [markdown]
# ## 4 In between: a path and one force
#
# For a time-optimal motion *along a path* the thesis (section 3.5) needs a model that is neither inverse nor forward:
# the plate is led along a line, and one motor pushes. Here: height and side are prescribed, motor 1 is given, and the
# robot may find out the rest. Two states are left, place and speed along the path.

# %%
path = robot.causal(known=["tau[0]", "T[1]", "T[2]"], targets=["der(T[0],2)", "tau[1]", "tau[2]"], prefer="T[0]")
print(excerpt(path))

by_name = {}
for i in range(3):
    by_name |= {f"T[{i}]": T[:, i], f"der(T[{i}])": Td[:, i], f"der(T[{i}],2)": Tdd[:, i], f"tau[{i}]": tau[:, i]}
along, second, third, status = path(*(by_name[signal.name] for signal in path.inputs))
assert path.plan.structure.degrees_of_freedom == 2 and all_solved(status)
np.testing.assert_allclose(along, Tdd[:, 0], atol=1e-8)
np.testing.assert_allclose(np.column_stack([second, third]), tau[:, 1:], rtol=1e-8, atol=1e-7)

# %% [markdown]
# ## 5 Let go
#
# A causality with states is a simulation. `problems/l1_drop.toml` lets the robot drop from rest with its motors off.
# Friction holds it back; it is smoothed around standstill, so that an integrator can step over it.

# %%
problem = load("problems/l1_drop.toml")
outcome = run.solve(problem, run.context_of(problem)).outcome
print(outcome.message)
for name, check in outcome.checks.items():
    print(f"{name}: {check.value:.1e} (at most {check.bound:.0e})")

# %%
outcome.figures["signals"]()

# %% [markdown]
# What is lost in height must be found in the friction. The components declare their energies; the error of the
# balance is that of the integrator.

# %%
outcome.figures["energy"]()

# %% [markdown]
# Two more ways to the same motion. Backwards: the inverse dynamics of its accelerations must say that the motors are
# off. And by differences: the recorded velocities must be the slopes of the recorded positions.

# %%
drop = gt.simulate(
    robot, 0.5, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3], "der(T)": 0.0}, outputs="der(T,2)", tolerance=1e-11
).trajectory
forces, status = inverse_dynamics(drop["T"], drop["der(T)"], drop["der(T,2)"])
print(f"largest force of the motors that are off: {np.max(np.abs(forces)):.1e} N")
assert all_solved(status) and np.max(np.abs(forces)) < 1e-8
assert all(check.passed for check in outcome.checks.values())
np.testing.assert_allclose(np.gradient(drop["T"], drop.time, axis=0)[1:-1], drop["der(T)"][1:-1], atol=1e-4)

# %% [markdown]
# The same engine takes any of the causalities above. On the path of section 4 with a constant force of motor 1 the
# plate swings through a valley of its own making; the other two motors do whatever the line asks of them.

# %%
force = float(inverse_dynamics([0.5, -0.9, 0.3], np.zeros(3), np.zeros(3))[0][0])
led = gt.simulate(
    robot,
    1.0,
    inputs={"tau[0]": force + 60.0, "T[1]": -0.9, "T[2]": lambda t: 0.3 + 0.1 * np.sin(2 * np.pi * t)},
    start={"T[0]": 0.5, "der(T[0])": 0.0},
    outputs="der(T,2)",
)
print(f"states: {', '.join(led.states)}; {led.message}; error of the energy balance {led.energy_error:.1e} J")
motion = led.trajectory
forces, status = inverse_dynamics(motion["T"], motion["der(T)"], motion["der(T,2)"])
assert all_solved(status)
np.testing.assert_allclose(forces, motion["tau"], atol=1e-7)

# %%
figure = Figure(figsize=(9, 3.2), layout="constrained")
place, effort = figure.subplots(1, 2)
place.plot(motion["T"][:, 0], motion["T"][:, 2], color="black")
place.set(title="path of the plate", xlabel="x [m]", ylabel="z [m]")
for i, colour in enumerate(("#0072b2", "#d55e00", "#009e73")):
    effort.plot(motion.time, motion["tau"][:, i], color=colour, label=f"motor {i + 1}{' (given)' if i == 0 else ''}")
effort.set(title="motor forces", xlabel="time [s]", ylabel="force [N]")
effort.legend(fontsize="small")
for axes in (place, effort):
    axes.grid(alpha=0.3)
figure

# %% [markdown]
# ## 6 Near one pose: a linear model
#
# A controller wants $\dot x = Ax + Bu$. At a pose that the motors hold, `linearize` gives a `control.StateSpace` with
# the names of the model. The robot has no springs: three of its modes are almost zero, it stays nearly where it is
# put (as the weight shifts it creeps, and with constant forces one way is away). The other three tell how fast
# friction stops it.

# %%
pose = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}
hold, _ = inverse_dynamics(pose["T"], np.zeros(3), np.zeros(3))
linear = gt.linearize(robot, "tau", "T", start=pose, input_values={"tau": hold}, prefer="T")
for mode in gt.natural_modes(linear):
    print(f"eigenvalue {mode.eigenvalue.real:9.3f} {mode.eigenvalue.imag:+.3f}i 1/s, moves {', '.join(mode.states)}")

# %% [markdown]
# Does it tell the truth? A push of a few newtons on the linear model, and on the real one.

# %%
push = np.array([8.0, -4.0, 6.0])
times = np.linspace(0.0, 0.3, 31)
expected = control.forced_response(linear, times, np.outer(push, np.ones(31))).outputs.T
pushed = gt.simulate(robot, 0.3, inputs={"tau": hold + push}, start=pose, step=0.01).trajectory["T"] - pose["T"]
moved, off = np.max(np.abs(pushed)), np.max(np.abs(pushed - expected))
print(f"moved by {1e3 * moved:.3f} mm; the linear model is {1e3 * off:.4f} mm off")
assert off < 0.02 * moved

# %%
flat = forward.flat
print(f"{len(flat.equations)} equations in {len(flat.variables)} variables")
assert len(flat.equations) == 129

# %% [markdown]
# ## Answer
#
# One set of 129 equations, written once as carts, rods, motors and a plate, answered kinematics both ways and in
# between, velocities, dynamics both ways and in between, a drop, a guided motion, and a linear model. What changes is
# only what is called known. The certificate tells what that costs: which equations are differentiated, which blocks
# have a closed form, how many states are left. And since all answers come from the same equations, each can be checked
# by another one.
