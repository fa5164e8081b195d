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
# The equations of a robot relate cart positions, plate position, velocities and forces. They do not say which of these
# are known and which are wanted. Textbooks solve them by hand, once for each question: forward kinematics, inverse
# kinematics, Jacobian, inverse dynamics, forward dynamics. Here the equations of the L1 prototype are written once, and
# each question takes one line. After each answer, `explain` shows how it was derived, and an `assert` checks it in an
# independent way.

# %%
# %matplotlib inline
import control
import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt

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
# The carts are known and the plate is wanted: three spheres intersect. The compiler finds the closed form, and the
# branch `plate_ahead`, which the robot declares, selects one of the two points of intersection.

# %%
forward = robot.causal(known="q", targets="T")
print(excerpt(forward))

# %% [markdown]
# The plate is known and the carts are wanted: each rod gives one quadratic equation. The equations are the same;
# nothing is rewritten.

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
# The known variables need not be all carts or all plate coordinates. Two carts and the height of the plate are three
# numbers as well. No textbook treats this question, but the compiler still finds closed forms: at a given height two
# spheres become two circles, and the third rod gives a quadratic again. Where no closed form exists, the compiler uses
# Newton's method.

# %%
mixed = robot.causal(known=["q[0]", "q[1]", "T[2]"], targets=["T[0]", "T[1]", "q[2]"])
print(excerpt(mixed))
x, y, third, status = mixed(q[:, 0], q[:, 1], T[:, 2])
assert all_solved(status)
np.testing.assert_allclose(np.column_stack([x, y, third]), np.column_stack([T[:, 0], T[:, 1], q[:, 2]]), atol=1e-9)

# %% [markdown]
# ## 2 Velocities
#
# A derivative is a target like any other. The compiler differentiates the closure equations (marked by primes) and
# solves them, which amounts to applying the Jacobian without forming its matrix. By hand, constant rod length means
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
# The motion is known and the motor forces are wanted. The head of the certificate says *index 3*: the closure equations
# must be differentiated twice before accelerations appear. Because the motion is known, nothing remains to be
# integrated: the system has no degrees of freedom.

# %%
inverse_dynamics = robot.causal(known="T", targets="tau")
print(excerpt(inverse_dynamics))

# %% [markdown]
# The forces are known and the accelerations are wanted. Now six numbers are free, three positions and three velocities:
# the states. `prefer` selects those of the plate or those of the carts.

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
# For a time-optimal motion *along a path*, the thesis (section 3.5) needs a model that is neither inverse nor forward:
# the plate follows a line, and one motor drives it. Here the height and the lateral position of the plate are
# prescribed and the force of motor 1 is known. Two states remain, position and velocity along the path.

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
# A causality with states can be simulated. `problems/l1_drop.toml` lets the robot drop from rest with its motors off.
# Friction slows it down; the friction is smoothed around zero velocity so that an integrator can handle the reversal.

# %%
outcome = gt.load("problems/l1_drop.toml")()
print(outcome.message)
for name, check in outcome.checks.items():
    print(f"{name}: {check.value:.1e} (at most {check.bound:.0e})")

# %%
outcome.figure("signals")

# %% [markdown]
# The potential energy that is lost must appear as kinetic energy and friction losses. The components declare their
# energies, so the error of the energy balance is the error of the integrator.

# %%
outcome.figure("energy")

# %% [markdown]
# Two more checks of the same motion. The inverse dynamics of its accelerations must give zero motor forces. And the
# differences of the recorded positions must match the recorded velocities.

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
# The simulator accepts any of the causalities above. Here the lateral position and the height of the plate are
# prescribed over time, and motor 1 applies a constant force, 60 N above the holding force. The plate moves freely along
# $x$, and the other two motors apply the forces that the prescribed coordinates require.

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
    effort.plot(motion.time, motion["tau"][:, i], color=colour, label=f"motor {i + 1}{' (known)' if i == 0 else ''}")
effort.set(title="motor forces", xlabel="time [s]", ylabel="force [N]")
effort.legend(fontsize="small")
for axes in (place, effort):
    axes.grid(alpha=0.3)
figure

# %% [markdown]
# ## 6 Near one pose: a linear model
#
# A controller design needs $\dot x = Ax + Bu$. At a pose where the motors hold the robot, `linearize` returns a
# `control.StateSpace` that uses the names of the model. The robot has no springs, so three of its modes are almost
# zero: it stays nearly where it is. (Its weight distribution changes with the pose, so it creeps, and under constant
# forces one direction is unstable.) The other three modes show how fast friction stops it.

# %%
pose = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}
hold, _ = inverse_dynamics(pose["T"], np.zeros(3), np.zeros(3))
linear = gt.linearize(robot, "tau", "T", start=pose, input_values={"tau": hold}, prefer="T")
for mode in gt.natural_modes(linear):
    print(f"eigenvalue {mode.eigenvalue.real:9.3f} {mode.eigenvalue.imag:+.3f}i 1/s, moves {', '.join(mode.states)}")

# %% [markdown]
# Is the linear model accurate? We apply a step of a few newtons to the linear model and to the nonlinear one.

# %%
push = np.array([8.0, -4.0, 6.0])
times = np.linspace(0.0, 0.3, 31)
expected = control.forced_response(linear, times, np.outer(push, np.ones(31))).outputs.T
pushed = gt.simulate(robot, 0.3, inputs={"tau": hold + push}, start=pose, step=0.01).trajectory["T"] - pose["T"]
moved, off = np.max(np.abs(pushed)), np.max(np.abs(pushed - expected))
print(f"moved by {1e3 * moved:.3f} mm; error of the linear model {1e3 * off:.4f} mm")
assert off < 0.02 * moved

# %%
flat = forward.flat
print(f"{len(flat.equations)} equations in {len(flat.variables)} variables")
assert len(flat.equations) == 129

# %% [markdown]
# ## Answer
#
# One set of 129 equations, written as carts, rods, motors and a plate, gave the kinematics in both directions and
# mixed, the velocities, the dynamics in both directions and mixed, a drop, a guided motion, and a linear model. Only
# the choice of known variables changes. The certificate shows the cost: which equations are differentiated, which
# blocks have a closed form, and how many states remain. All answers come from the same equations, so each can be
# checked against another.
