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
# # Mechanisms
#
# **How many solutions does a parallel robot have, and what does it take from its drawing to code for its controller?**
#
# Three parallel robots are drawn by connecting joints, rods and points: a rotary delta, a planar five-bar (5R) and a
# planar 3-RRR. Their dimensions are an example of ours, in `problems/models/mechanisms.py`. This notebook counts their
# degrees of freedom, finds all solutions of their kinematics, computes a fastest motion, calibrates one from synthetic
# poses, and writes its C code.

# %%
# %matplotlib inline
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt

# the model that each problem is about
FILES = {"Delta": "rotary_delta", "FiveBar": "five_bar", "ThreeArms": "planar_3rrr"}
robots = {name: gt.load(f"problems/calibrate_{file}.toml").arguments[0] for name, file in FILES.items()}

# %% [markdown]
# ## 1 Degrees of freedom
#
# The mobility is judged by the rank of the constraints, at the start position and at positions that small motions reach
# from it. Rods between ball joints leave no constraint redundant.

# %%
reports = [robot.mobility() for robot in robots.values()]
print(*reports, sep="\n\n")
assert [r.mobility for r in reports] == [3, 2, 3]
assert [r.redundant for r in reports] == [0, 0, 0]

# %% [markdown]
# Four pins in space are another matter: three of their constraints are redundant. If all pins are in line the
# linkage cannot move, in spite of two degrees of freedom by its rank, and gtmodel says so.


# %%
class FourBar(gt.Model):
    lengths = gt.parameter([0.3, 0.7, 0.6, 0.8], unit="m")
    ground, motor = gt.part(gt.mechanics.Ground), gt.part(gt.mechanics.TorqueMotor)
    crank, elbow, tip, rocker = (gt.part(gt.mechanics.Revolute) for _ in range(4))
    bar = gt.part(gt.mechanics.FixedTranslation, d=lambda s: [s.lengths[0], 0.0, 0.0])
    top = gt.part(gt.mechanics.FixedTranslation, d=lambda s: [s.lengths[1], 0.0, 0.0])
    arm = gt.part(gt.mechanics.FixedTranslation, d=lambda s: [s.lengths[2], 0.0, 0.0])
    base = gt.part(gt.mechanics.FixedTranslation, d=lambda s: [s.lengths[3], 0.0, 0.0])

    def equations(self):
        yield gt.connect([self.ground.frame, self.crank.b, self.bar.b], [self.crank.a, self.bar.a, self.elbow.a])
        yield gt.connect([self.elbow.b, self.top.b], [self.top.a, self.tip.a])
        yield gt.connect([self.ground.frame, self.base.b, self.rocker.b], [self.base.a, self.rocker.a, self.arm.a])
        yield gt.connect([self.arm.b, self.motor.shaft], [self.tip.b, self.crank.shaft])
        yield gt.loops(redundant="drop")


print(FourBar().mobility())
try:
    FourBar(lengths=[0.3, 0.4, 0.5, 1.2]).causal("crank.shaft.phi", "rocker.shaft.phi")
except gt.ModelError as error:
    print("\n" + str(error).rpartition(" (")[0])
    assert "mobility 0" in str(error)

# %% [markdown]
# ## 2 All solutions
#
# Each declared branch has two sides. The inverse functions are closed forms: an arm whose end is a rod's length away
# from a known point has two angles. The 3-RRR has eight solutions for one pose.

# %%
planar = robots["ThreeArms"]
A, B, L1, L2 = (np.array(a) for a in (planar.A, planar.B, planar.upper, planar.lower))
x, angle = np.array([0.41, 0.26]), 0.15


def corners(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    return x + B @ np.array([[c, s], [-s, c]])


def elbows(q):
    return A + L1[:, None] * np.column_stack([np.cos(q), np.sin(q)])


def drawn(axes, q, x, angle):
    for a, e, c in zip(A, elbows(q), corners(x, angle), strict=True):
        axes.plot(*np.array([a, e, c]).T, "o-", color="0.4", markersize=3)
    axes.fill(*corners(x, angle).T, alpha=0.5)
    axes.set(aspect="equal", xticks=[], yticks=[], xlim=(-0.5, 1.2), ylim=(-0.5, 1.2))


figure = Figure(figsize=(9, 4.8), layout="constrained")
for axes, sides in zip(figure.subplots(2, 4).flat, product((1, -1), repeat=3), strict=True):
    inverse = planar.causal(["x", "angle"], "q", branches={f"elbow_{k}": s for k, s in enumerate(sides)})
    q, status = inverse(x, angle)
    assert status == gt.Status.OK
    assert np.allclose(np.linalg.norm(elbows(q) - corners(x, angle), axis=1), L2, atol=1e-12)
    drawn(axes, q, x, angle)
    axes.set_title("".join("left " if s > 0 else "right " for s in sides), fontsize="small")
figure

# %% [markdown]
# The forward kinematics of the 3-RRR is a polynomial of degree six. For these motor angles all six solutions are real.

# %%
q = np.array([1.26, 2.14, -1.54])
found, angles = gt.kinematics.planar_modes(elbows(q), B, L2)
assert len(angles) == 6
figure = Figure(figsize=(9, 6), layout="constrained")
for axes, place, turned in zip(figure.subplots(2, 3).flat, found, angles, strict=True):
    assert np.allclose(np.linalg.norm(elbows(q) - corners(place, turned), axis=1), L2, atol=1e-9)
    drawn(axes, q, place, turned)
    axes.set_title(f"{np.degrees(turned):.0f} deg", fontsize="small")
figure

# %% [markdown]
# Delta and five-bar have two forward solutions each, in closed form. The number of operations:

# %%
for name, pose in (("Delta", "T"), ("FiveBar", "x")):
    for known, target in (("q", pose), (pose, "q")):
        f = robots[name].causal(known, target)
        assert not f.kernels  # no Newton block
        print(f"{name}: {target} from {known}: {f.casadi.n_instructions()} operations")

# %% [markdown]
# ## 3 A fastest motion
#
# From rest to rest, with a limit on each motor's torque. Most of the time one motor is at its limit. The result is
# re-simulated by an error-controlled integrator.

# %%
motion = gt.load("problems/five_bar_motion.toml")()
assert motion.status.ok
time, tau = motion.trajectory.time, motion.trajectory["robot.tau"]
figure = Figure(figsize=(9, 3.2), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(*motion.trajectory["robot.x"].T)
left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="tool centre point")
right.plot(time, tau)
right.set(xlabel="time [s]", ylabel="torque [N m]", title="motors, at most 12 N m")
print(f"{time[-1]:.3f} s")
assert np.mean(np.abs(tau).max(axis=1) > 0.98 * 12) > 0.5
figure

# %% [markdown]
# ## 4 A calibration
#
# The poses are **synthetic**: seed 4405, errors of 1 mm in the lengths and 5 mrad in the zeros of the motors, noise
# 30 um. All twelve free parameters of the delta robot are determined.

# %%
study = gt.load("problems/calibrate_rotary_delta.toml", "sensitivity_step=0.0")()
print(f"held-out poses: {1e3 * study.a_priori['mean']:.2f} mm before, {1e3 * study.held_out['mean']:.3f} mm after")
print(f"upper[0] = {study.parameters['upper[0]']:.5f} m, 95 % interval", study.interval("upper[0]"))
assert study.status.ok
assert study.held_out["mean"] < study.a_priori["mean"] / 30
study.figure("pose_errors")

# %% [markdown]
# ## 5 Code
#
# The C code of the closed forms equals Python bit for bit.

# %%
delta = robots["Delta"]
functions = {"fk": delta.causal("q", "T"), "ik": delta.causal("T", "q")}
place = Path(tempfile.mkdtemp())
gt.cgen.generate(
    functions, place / "c", name="delta", box={"q": [[0.1, 0.5]], "T": [[-0.1, 0.1], [-0.1, 0.1], [-0.8, -0.7]]}
)
report = gt.cgen.check(place / "c", functions, points=200, seed=1)
print(", ".join(report.checks))
assert all(check.passed for check in report.checks.values())

# %% [markdown]
# ## Answer
#
# A delta robot has two forward and eight inverse solutions, a five-bar two and four, a planar 3-RRR up to six and
# eight. All but the six come in closed form from the connected parts, with fewer than 250 operations. The drawing is
# enough for the rest: `problems/` holds a fastest motion, a calibration and C code of each of the three robots, and
# `gtmodel codegen problems/rotary_delta_controller.toml -o build/delta --fmu both --check` writes functional mock-up
# units. The page [mechanisms](../docs/howto/mechanisms.md) lists the joints and the ways to resolve redundant
# constraints.
