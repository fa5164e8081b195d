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
# # All assembly modes
#
# **In how many ways can the same links be assembled, and could the robot silently be in another one?**
#
# The carts are at rest and the six link lengths are known. Forward kinematics asks for the pose of the plate. The
# equations have 40 solutions over the complex numbers, and each real solution is a pose in which the same robot could
# be assembled. An iteration finds one of them and reports success. Which one, and what are the others?

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.kinematics.assembly_modes import assembly_modes, assembly_modes_batch

# %% [markdown]
# ## 1 All of them
#
# The robot is the F1 in the middle of its workspace; `gtmodel solve problems/f1_modes.toml --plot` does the same on the
# command line. The search follows 40 paths from a stored platform whose solutions are known. The certificate counts the
# solutions at the ends of the paths: for each one a test proves that exactly one solution lies within a radius, and no
# two coincide.

# %%
outcome = gt.load("f1_modes")()
print(outcome.message)
for label, value, unit in outcome.rows[:8]:
    shown = value if isinstance(value, str) else f"{value:.4g}"
    print(f"{label:<34} {shown} {unit}".rstrip())
print({name: check.passed for name, check in outcome.checks.items()})

# %% [markdown]
# Eight solutions are real: four with the plate above the carts, four below. The marked one is the commanded pose.

# %%
outcome.figure("modes")

# %% [markdown]
# ## 2 Newton's answer against the certificate
#
# We draw 40 synthetic poses within 0.3 m and 25 degrees of home (seed 1). The inverse kinematics gives the axes, and
# the forward kinematics takes the axes back to a pose. The forward kinematics follows the solution from the home pose
# to the given axes, in steps small enough not to jump to another mode. Does it return to the original pose, and is that
# pose in the list?

# %%
robot = gt.robots.f1_gantry_tau()
forward = robot.causal("q", ["T", "R"])
inverse = robot.causal(["T", "e"], "q")
joints = robot.causal("q", [f"link[{k}].a.r" for k in range(6)])
B, L = np.asarray(robot.B), np.asarray(robot.L)

random = np.random.default_rng(1)
n = 40
T = robot.home + random.uniform(-0.3, 0.3, (n, 3))
turn = Rotation.from_rotvec(np.radians(25) / np.sqrt(3) * random.uniform(-1, 1, (n, 3)))
e = (turn * Rotation.from_quat(robot.home_e, scalar_first=True)).as_quat(scalar_first=True)
q, status = inverse(T, e)
T_newton, R_newton, back = forward(q)
assert not status.any() and not back.any()


def at(q):
    """Cart joints, (n, 6, 3) [m]."""
    return np.stack(joints(q)[:-1], axis=1)


found = assembly_modes_batch(at(q), B, L)
mine = [modes.nearest(R_newton[i], T_newton[i])[0] for i, modes in enumerate(found)]
worst = max(modes.nearest(R_newton[i], T_newton[i])[1] for i, modes in enumerate(found))
complete = sum(modes.ok for modes in found)
print(f"complete certificates: {complete} of {n}; real modes: {sorted({len(modes.T) for modes in found})}")
print(f"distance of the forward kinematics from the commanded pose: {np.abs(T_newton - T).max():.1e} m")
print(f"distance from the nearest mode of the certificate: {worst:.1e} m")
assert all(modes.ok for modes in found) and worst < 1e-9 and np.abs(T_newton - T).max() < 1e-9

# %% [markdown]
# ## 3 A Newton iteration that does not know where it comes from
#
# This is the plain Newton iteration of many programs: start somewhere near, and iterate until the lengths match. The
# start is the commanded pose, displaced by up to 0.4 m along each axis and rotated by up to 90 degrees (synthetic, seed
# 2).

# %%
i = 0
A = at(q)[i]


def plain_newton(T, R):
    """Fifty iterations on position and rotation; returns T, R and the largest length error [m]."""
    for _ in range(50):
        arm = B @ R.T
        d = T + arm - A
        length = np.linalg.norm(d, axis=1)
        step = np.linalg.lstsq(np.hstack([d, np.cross(arm, d)]) / length[:, None], L - length)[0]
        T, R = T + step[:3], Rotation.from_rotvec(step[3:]).as_matrix() @ R
    return T, R, np.abs(np.linalg.norm(T + B @ R.T - A, axis=1) - L).max()


random = np.random.default_rng(2)
ends = np.zeros(len(found[i].T), dtype=int)
failed = 0
for _ in range(100):
    away = Rotation.from_rotvec(np.radians(90) / np.sqrt(3) * random.uniform(-1, 1, 3)).as_matrix()
    T_end, R_end, error = plain_newton(T[i] + random.uniform(-0.4, 0.4, 3), away @ R_newton[i])
    k, distance, angle = found[i].nearest(R_end, T_end)
    if error < 1e-12 and distance < 1e-9:
        ends[k] += 1
    else:
        failed += 1
print(f"commanded mode: {mine[i] + 1}; converged to modes 1 to {len(ends)}: {ends}; not converged: {failed}")
wrong = ends.sum() - ends[mine[i]]
print(f"{wrong} of 100 starts converge to another mode, with all lengths right to 1e-12 m")

# %% [markdown]
# The lengths cannot reveal the mode, because they are right in every mode. The converged poses are all in the list of
# the certificate.

# %% [markdown]
# ## 4 How near is the next one?
#
# A robot does not jump by decimetres. It can change its mode where two modes meet: there the equations are singular,
# and the plate can leave in either mode. Here only axis 4 turns, starting from 0, while the other axes are at rest.

# %%
angle = np.linspace(0.0, 0.85, 86)
way = q[i] + (angle - q[i, 3])[:, None] * np.eye(6)[3]
T_way, R_way, status = forward(way)
modes = assembly_modes_batch(at(way), B, L)
reached = status == 0
gap, turned = np.full((2, len(way)), np.nan)
for j in np.flatnonzero(reached):
    k = modes[j].nearest(R_way[j], T_way[j])[0]
    distance = 1e3 * np.linalg.norm(modes[j].T - modes[j].T[k], axis=1)
    distance[k] = np.inf
    other = int(np.argmin(distance))
    gap[j] = distance[other]
    turned[j] = np.degrees(Rotation.from_matrix(modes[j].R[k].T @ modes[j].R[other]).magnitude())
count = np.array([len(m.T) for m in modes])

figure = Figure(figsize=(11, 3.4), layout="constrained")
left, middle, right = figure.subplots(1, 3)
left.plot(np.degrees(angle), gap, color="#0072b2")
left.set(xlabel="axis 4 [deg]", ylabel="distance of T [mm]", title="nearest other mode")
middle.plot(np.degrees(angle), turned, color="#0072b2")
middle.set(xlabel="axis 4 [deg]", ylabel="angle between the plates [deg]", title="nearest other mode")
right.step(np.degrees(angle), count, where="post", color="black", label="real modes")
right.plot(np.degrees(angle[~reached]), count[~reached], "x", color="#d55e00", label="forward kinematics: no solution")
right.set(xlabel="axis 4 [deg]", ylabel="number of real modes", title="real modes", ylim=(0, 10))
right.legend(fontsize="small", loc="lower left")
for axes in (left, middle, right):
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
figure

# %%
last = int(np.flatnonzero(reached)[-1])
print(
    f"last solution at {np.degrees(angle[last]):.1f} deg: other mode {gap[last]:.0f} mm and {turned[last]:.0f} deg away"
)
print(f"real modes there {count[last]}, one step later {count[last + 1]}")

# %%
alone = assembly_modes(at(q)[i], B, L)
assert len(alone.T) == 8 and alone.certificate.finite == 40
assert wrong > 0, "plain Newton converges to other modes, with every length right"
assert not reached[-1] and np.all(np.diff(reached.astype(int)) <= 0), "past the meeting point nothing is returned"
assert count[last + 1] == count[last] - 2, "the two modes that met are gone"

# %% [markdown]
# ## Answer
#
# In the middle of the workspace the F1 can be assembled in 8 ways, and the certificate shows that there is no ninth.
# Yes, it could silently be in another mode: the lengths match in every mode, and a Newton iteration from a poor start
# can converge to a wrong one without a warning. `forward` follows the pose from home instead, and gave the commanded
# mode for all 40 synthetic poses. Where its mode meets another, it stops with a status. The distance to the nearest
# mode shows in advance that such a point is near.
