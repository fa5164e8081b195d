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
# # Your own model
#
# **Can I write my own mechanism once, and ask it anything?**
#
# You write the equations of motion as physics states them, in any order, without solving any of them by hand. Then you
# name the known variables and the targets. gtmodel decides which equations to differentiate, in which order to solve
# them, and which root to take.
#
# There are three mechanisms: a pendulum, a four-bar linkage, and a parallel robot. Each part ends in an `assert` that
# compares the answer with an independent formula.

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import gtmodel as gt
from gtmodel import der

# %% [markdown]
# ## 1 A pendulum in the simplest coordinates
#
# A mass $m$ hangs on a massless rod of length $L$. A motor at the pivot applies the torque `tau`. In the coordinates
# $x$ (right) and $y$ (up), Newton's law is trivial, and the rod adds one constraint: its length is constant. The
# tension of the rod per unit length, `lam`, is one more unknown.
#
# Standard integrators cannot handle this system directly. The length constraint contains neither `lam` nor an
# acceleration; it must be differentiated twice before they appear (a DAE of index 3). Most tools expect you to do this
# by hand.


# %%
class Pendulum(gt.Model):
    """Point mass on a massless rod; a motor at the pivot. x to the right, y upwards [m]."""

    L = gt.parameter(1.0, unit="m", positive=True)
    m = gt.parameter(1.0, unit="kg", positive=True)
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(unit="m", start=0.6)
    y = gt.variable(unit="m", start=-0.8)
    lam = gt.variable(unit="N/m", description="tension of the rod per unit length")
    tau = gt.input(unit="N.m", description="motor torque, counter-clockwise positive")

    def equations(self):
        drive = self.tau / self.L**2
        yield self.m * der(self.x, 2) == -self.lam * self.x - drive * self.y
        yield self.m * der(self.y, 2) == -self.lam * self.y + drive * self.x - self.m * self.g
        yield self.x**2 + self.y**2 == self.L**2


pendulum = Pendulum()

# %% [markdown]
# ### A mistake that is worth making
#
# Why is $g$ a parameter with a unit? A bare number has no unit: with `9.81` in its place, $m \cdot 9.81$ would be a
# mass. The dimension check finds the error before anything is computed, and names the line.


# %%
class Careless(Pendulum):
    def equations(self):
        yield self.m * der(self.y, 2) == -self.lam * self.y - self.m * 9.81


try:
    Careless().causal(known="tau", targets="lam")
except gt.ModelError as error:
    refusal = str(error)
print(refusal)
assert "left is N, right is kg" in refusal

# %% [markdown]
# ### Known variables and targets
#
# The torque is known. The targets are the accelerations and the tension of the rod. `causal` returns a function. Its
# inputs are the states, which gtmodel chooses, followed by the known variables.

# %%
accelerations = pendulum.causal(known="tau", targets=["der(x,2)", "der(y,2)", "lam"])
accelerations

# %% [markdown]
# `explain()` prints the certificate: the states, the blocks in the order of solution, the sign that selects each root,
# the expressions that must not vanish, and the source line of each equation. A prime marks a differentiated equation:
# `equation 3''` is the length constraint, differentiated twice.

# %%
print(accelerations.explain())

# %% [markdown]
# The function accepts one state or many rows at once. It returns the values, followed by a status. We compare the
# values with the textbook formula in the angle $\varphi$ from the lower rest position: $mL^2\ddot\varphi = \tau -
# mgL\sin\varphi$.

# %%
rng = np.random.default_rng(1)
L, m, g = (float(value) for value in (pendulum.L, pendulum.m, pendulum.g))
phi, omega, torque = rng.uniform(-1.4, 1.4, (3, 200))
sine, cosine = np.sin(phi), np.cos(phi)

ax, ay, lam, status = accelerations(L * sine, L * cosine * omega, torque)

angular = (torque - m * g * L * sine) / (m * L**2)
np.testing.assert_array_equal(status, gt.Status.OK)
np.testing.assert_allclose(ax, L * (cosine * angular - sine * omega**2), atol=1e-11)
np.testing.assert_allclose(ay, L * (sine * angular + cosine * omega**2), atol=1e-11)
np.testing.assert_allclose(lam, m * (omega**2 + g / L * cosine), atol=1e-11)

# %% [markdown]
# ### Let it swing
#
# The function is an ordinary right-hand side. We release the pendulum at 60 degrees and integrate it with SciPy for 10
# s. A second function returns the height and its rate. `y` follows from `x`, so it is evaluated, not integrated.

# %%
release = np.pi / 3
height = pendulum.causal(known="tau", targets=["y", "der(y)"])


def rates(_, state):
    x, xd = state
    return xd, accelerations(x, xd, 0.0)[0]


def upwards(_, state):
    return state[0]


upwards.direction = 1
precise = dict(method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.05)
swing = solve_ivp(rates, (0.0, 10.0), (L * np.sin(release), 0.0), events=upwards, **precise)
x, xd = swing.y
y, yd, status = height(x, xd)
energy = m / 2 * (xd**2 + yd**2) + m * g * y
drift = energy - energy[0]
print(f"largest energy error in 10 s: {np.max(np.abs(drift)):.1e} J of {m * g * L * (1 - np.cos(release)):.3f} J")

# %%
figure = Figure(figsize=(10, 3.2), layout="constrained")
path, error = figure.subplots(1, 2)
path.plot(swing.t, np.degrees(np.arctan2(x, -y)), color="black")
path.set(title="swing", xlabel="time [s]", ylabel="angle [deg]")
error.plot(swing.t, drift, color="#d55e00")
error.set(title="energy error of the integrator", xlabel="time [s]", ylabel="energy error [J]")
for axes in (path, error):
    axes.grid(alpha=0.3)
figure

# %% [markdown]
# The remaining error is that of the integrator. The rod cannot stretch, because $y$ follows from $x$ at every instant.
#
# An energy test cannot detect a wrong time scale. The period of a large swing is also known, as a complete elliptic
# integral: $4\sqrt{L/g}\,K(\sin^2(\varphi_0/2))$.

# %%
period = np.diff(swing.t_events[0])
exact = 4 * np.sqrt(L / g) * ellipk(np.sin(release / 2) ** 2)
print(f"period {period.mean():.9f} s, exact {exact:.9f} s")
np.testing.assert_array_equal(status, gt.Status.OK)
assert np.max(np.abs(drift)) < 1e-8
np.testing.assert_allclose(period, exact, rtol=1e-8)

# %% [markdown]
# ### Turn it round
#
# Now the motion $x(t)$ is known and the torque is the target. The model stays as it is; only the question changes. A
# known variable brings its derivatives as inputs, up to the order that the equations need.

# %%
torque_for = pendulum.causal(known="x", targets=["tau", "y", "lam"])
torque_for

# %%
wanted, y, lam, status = torque_for(L * sine, L * cosine * omega, ax)
np.testing.assert_array_equal(status, gt.Status.OK)
np.testing.assert_allclose(wanted, torque, atol=1e-11)
np.testing.assert_allclose(y, -L * cosine, atol=1e-13)

# %% [markdown]
# A question without a solution is refused, and the message names the surplus equations. Motion and torque cannot both
# be prescribed.

# %%
try:
    pendulum.causal(known=["x", "tau"], targets="lam")
except gt.ModelError as error:
    refusal = str(error)
print(refusal)
assert "too many" in refusal

# %% [markdown]
# Data without a solution give NaN and a status that states the reason, never a wrong number. The rod does not
# reach $x = 1.2$ m. At $x = L$ the state $x$ does not determine the motion.

# %%
_, _, _, status = accelerations(np.array([0.6, 1.0, 1.2]), np.zeros(3), np.zeros(3))
for code in status:
    print(gt.Status(code).name, "-", gt.Status(code).message)
print(accelerations.diagnose(1.2, 0.0, 0.0))
assert list(status) == [gt.Status.OK, gt.Status.SINGULAR, gt.Status.OUT_OF_RANGE]

# %% [markdown]
# ## 2 A four-bar: which of the two?
#
# The linkage has a crank $AB$, a coupler $BC$ and a rocker $DC$. Two circles intersect in two points, so the joint $C$
# has two possible positions for each crank angle. `branch` takes an expression whose sign tells them apart. Here the
# expression says on which side of the diagonal $BD$ the joint $C$ lies.


# %%
class FourBar(gt.Model):
    """Planar four-bar A B C D; A is the origin, D = (d, 0). Branch `open`: C is to the left of the line from B to D."""

    a = gt.parameter(0.3, unit="m", positive=True, description="crank AB")
    b = gt.parameter(0.7, unit="m", positive=True, description="coupler BC")
    c = gt.parameter(0.6, unit="m", positive=True, description="rocker DC")
    d = gt.parameter(0.8, unit="m", positive=True, description="frame AD")
    theta = gt.variable(unit="1", description="crank angle [rad]")
    B = gt.variable(2, unit="m")
    C = gt.variable(2, unit="m", start=[0.5, 0.5])

    def equations(self):
        coupler = self.C - self.B
        rocker = gt.vector([self.C[0] - self.d, self.C[1]])
        diagonal = gt.vector([self.d - self.B[0], -self.B[1]])
        yield self.B[0] == self.a * gt.cos(self.theta)
        yield self.B[1] == self.a * gt.sin(self.theta)
        yield gt.dot(coupler, coupler) == self.b**2
        yield gt.dot(rocker, rocker) == self.c**2
        yield gt.branch("open", diagonal[0] * coupler[1] - diagonal[1] * coupler[0])


fourbar = FourBar()
turn = np.linspace(0, 2 * np.pi, 181)
modes = {side: fourbar.causal(known="theta", targets=["B", "C"], branches={"open": side})(turn) for side in (1, -1)}

# %%
figure = Figure(figsize=(6.5, 4.5), layout="constrained")
axes = figure.subplots()
for side, colour in ((1, "#0072b2"), (-1, "#d55e00")):
    B, C, _ = modes[side]
    middle = (B + C) / 2
    axes.plot(*middle.T, color=colour, label="open" if side > 0 else "crossed")
    k = 30  # one pose of the mechanism
    axes.plot(*np.transpose([(0, 0), B[k], C[k], (0.8, 0)]), "o-", color=colour, alpha=0.4)
axes.set(title="middle of the coupler over one turn of the crank", xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.grid(alpha=0.3)
axes.legend()
figure

# %% [markdown]
# The cross-check is elementary geometry: the law of cosines in the triangle $BCD$.

# %%
a, b, c, d = (float(value) for value in (fourbar.a, fourbar.b, fourbar.c, fourbar.d))
for side, (B, C, status) in modes.items():
    to_B = B - [d, 0.0]
    diagonal = np.hypot(*to_B.T)
    at_D = np.arccos((diagonal**2 + c**2 - b**2) / (2 * diagonal * c))
    rocker = np.arctan2(to_B[:, 1], to_B[:, 0]) - side * at_D
    np.testing.assert_array_equal(status, gt.Status.OK)
    np.testing.assert_allclose(C, np.column_stack([d + c * np.cos(rocker), c * np.sin(rocker)]), atol=1e-13)

# %% [markdown]
# ## 3 A parallel robot
#
# The Gantry-Tau has three carts on parallel guideways, and one rod from each cart to a common plate. The model is
# written in the same language (`gtmodel/robots/three_link.py`) from carts, rods, friction and motors that are
# connected. `q` are the cart positions, `T` is the tool centre point (TCP), and `tau` are the motor forces. The
# dimensions are those of the L1 prototype (Dressler 2012).
#
# The next cell derives five functions. Each takes one line that names the known variable and the targets.

# %%
robot = gt.robots.gantry_tau("l1_tape")

forward = robot.causal(known="q", targets="T")
inverse = robot.causal(known="T", targets="q")
velocity = robot.causal(known="q", targets="der(T)")
inverse_dynamics = robot.causal(known="T", targets="tau")
forward_dynamics = robot.causal(known="tau", targets="der(T,2)", prefer="T")
for function in (forward, inverse, velocity, inverse_dynamics, forward_dynamics):
    print(function)

# %% [markdown]
# `prefer="T"` makes the TCP the state of the forward dynamics; `prefer="q"` would choose the carts. The compiler finds
# the forward kinematics in closed form, as the intersection of three spheres.

# %%
print(forward.explain())

# %% [markdown]
# Are these functions correct? We test 200 poses with velocities and accelerations. Forward and inverse must cancel, in
# kinematics and in dynamics.

# %%
n = 200
T = np.array([0.5, -0.7, 0.5]) + rng.uniform(-0.4, 0.4, (n, 3))
Td = rng.uniform(-1.0, 1.0, (n, 3))
Tdd = rng.uniform(-5.0, 5.0, (n, 3))

q, status = inverse(T)
back, status_back = forward(q)
assert np.all(status == gt.Status.OK) and np.all(status_back == gt.Status.OK)
np.testing.assert_allclose(back, T, atol=1e-12)

tau, status = inverse_dynamics(T, Td, Tdd)
found, status_back = forward_dynamics(T, Td, tau)
assert np.all(status == gt.Status.OK) and np.all(status_back == gt.Status.OK)
np.testing.assert_allclose(found, Tdd, atol=1e-9)

# %% [markdown]
# Every function also has a Jacobian. The Jacobian of the forward kinematics maps cart velocities to the TCP velocity.
# Its inverse can be derived by hand, because rod $i$ has constant length: with the rod vector $d_i$ and the guideway
# direction $v_i$, row $i$ of $J^{-1}$ is $d_i^T / (d_i \cdot v_i)$.

# %%
J, status = forward.jacobian(q)
rods = T[:, None, :] - robot.A - q[:, :, None] * robot.v
by_hand = rods / np.sum(rods * robot.v, axis=2, keepdims=True)
assert np.all(status == gt.Status.OK)
np.testing.assert_allclose(by_hand @ J, np.broadcast_to(np.eye(3), (n, 3, 3)), atol=1e-12)

qd = np.einsum("nij,nj->ni", by_hand, Td)
np.testing.assert_allclose(velocity(q, qd)[0], Td, atol=1e-12)

# %% [markdown]
# ### Where can it go?
#
# We evaluate the inverse kinematics on a grid of points. Points out of reach raise no exception: their rows are NaN,
# with the status `OUT_OF_RANGE`. The inverse dynamics at rest, on the same grid, gives the motor forces that hold the
# plate. The guideways run along $x$, so this slice is the same at every $x$.

# %%
y_axis, z_axis = np.linspace(-2.0, 0.8, 141), np.linspace(-0.6, 2.0, 131)
y_grid, z_grid = np.meshgrid(y_axis, z_axis)
grid = np.column_stack([np.full(y_grid.size, 0.5), y_grid.ravel(), z_grid.ravel()])
rest = np.zeros_like(grid)

_, status = inverse(grid)
tau, _ = inverse_dynamics(grid, rest, rest)
holding = np.max(np.abs(tau), axis=1).reshape(y_grid.shape)
for code, count in zip(*np.unique(status, return_counts=True), strict=True):
    print(f"{gt.Status(code).name:13} {count:6} points")

# %%
figure = Figure(figsize=(7, 5), layout="constrained")
axes = figure.subplots()
shown = axes.pcolormesh(y_axis, z_axis, holding, cmap="viridis")
figure.colorbar(shown, label="largest motor force at rest [N]")
bow = np.linspace(0, 2 * np.pi, 361)
for i in range(3):
    _, y0, z0 = robot.A[i]
    reach = "reach of a link" if i == 0 else None
    circle = y0 + robot.L[i] * np.cos(bow), z0 + robot.L[i] * np.sin(bow)
    axes.plot(*circle, "--", color="0.5", linewidth=0.8, label=reach)
    axes.plot(y0, z0, "ks")
    axes.annotate(f"guideway {i + 1}", (y0, z0), xytext=(0, 8), textcoords="offset points", ha="center")
axes.set(title="reachable slice of the L1 prototype", xlabel="y [m]", ylabel="z [m]", aspect="equal")
axes.set(xlim=(-2.0, 0.8), ylim=(-0.6, 2.0))
axes.legend(loc="lower left")
figure

# %% [markdown]
# Geometry gives the same answer without a solver: a rod reaches a point if the distance of the point from the guideway
# is at most the length of the rod. The slice is the intersection of three discs.

# %%
from_guideway = np.hypot(grid[:, None, 1] - robot.A[:, 1], grid[:, None, 2] - robot.A[:, 2])
in_all_discs = np.all(from_guideway <= robot.L, axis=1)
np.testing.assert_array_equal(status == gt.Status.OK, in_all_discs)
assert set(status) == {gt.Status.OK, gt.Status.OUT_OF_RANGE}
np.testing.assert_array_equal(np.isfinite(holding).ravel(), in_all_discs)

# %% [markdown]
# ### Swap a part
#
# The thesis lumps the mass of each link cluster at the middle of its rod. The mass of a real rod is distributed, so the
# rod also has a moment of inertia, $m_a L^2/12$. The rod class is an argument of the robot; nothing else changes.

# %%
m_a = [2.0, 1.5, 3.0]  # kg
lumped = gt.robots.gantry_tau("l1_tape", m_a=m_a)
spread = gt.robots.gantry_tau("l1_tape", m_a=m_a, rod=gt.mechanics.UniformRod)

question = dict(known="T", targets=["tau", "q", "der(q,2)"])
tau_lumped, q, qdd, _ = lumped.causal(**question)(T, Td, Tdd)
tau_spread, *_ = spread.causal(**question)(T, Td, Tdd)
print("largest difference of the motor forces [N]:", np.max(np.abs(tau_spread - tau_lumped), axis=0).round(2))

# %% [markdown]
# The cross-check is virtual work. Rotating a uniform rod takes the force $\frac{m_a}{12}(\ddot r_a - \ddot r_b)$ at its
# cart end $a$, and the opposite force at its plate end $b$. When cart $j$ moves by $\delta q_j$, the cart end of rod
# $i$ moves by $v_i\,\delta_{ij}\,\delta q_j$, and the plate end by column $j$ of $J$ times $\delta q_j$. The sum over
# the rods is the difference of the motor forces.

# %%
expected = np.zeros_like(tau_lumped)
for i in range(3):
    turning = m_a[i] / 12 * (qdd[:, i, None] * robot.v[i] - Tdd)
    relative = -J.copy()
    relative[:, :, i] += robot.v[i]
    expected += np.einsum("nk,nkj->nj", turning, relative)
assert np.max(np.abs(expected)) > 1.0
np.testing.assert_allclose(tau_spread - tau_lumped, expected, atol=1e-10)

# %% [markdown]
# ## Answer
#
# Yes. One pendulum model gave accelerations, a simulation and the motor torque. The four-bar gave both of its assembly
# modes. The robot gave its kinematics, its Jacobian and its dynamics in both directions. Independent formulas confirmed
# each answer, and questions without an answer were refused with a reason.
#
# Next: `02_playing_with_the_optimal_motion` lets the robot move as fast as it can.
