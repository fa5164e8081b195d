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
# # Every point of the box
#
# **A controller was tested at ten thousand random points of a workspace. What can be said about the other points?**
#
# Interval arithmetic evaluates the operations of a function for a whole box of inputs at once. Each result is an
# interval that contains the results for all points, round-off included. Where the interval is too wide to decide, the
# box is cut in halves. What is proved this way holds at every point; what is not decided is said, with its volume.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt

robot = gt.robots.gantry_tau("l1_tape")
inverse = robot.causal(known="T", targets="q")

# %% [markdown]
# ## 1 One box is enough
#
# The inverse kinematics of the L1 over 0.8 x 0.4 x 0.5 m: every root has a positive radicand at every point. The
# operations of the function, which are those of its C code, are evaluated once.

# %%
box = {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]]}
proof = gt.certify.study(inverse, box)
print(proof)

# %% [markdown]
# 20,000 random points agree, but prove nothing.

# %%
low, high = np.array(box["T"]).T
T = np.random.default_rng(1).uniform(low, high, (20_000, 3))
q, status = inverse(T)
assert not status.any()
assert all(a <= q[:, k].min() and q[:, k].max() <= b for k, (a, b) in enumerate(proof.ranges.values()))

# %% [markdown]
# ## 2 Where it does not hold
#
# A box that reaches too far: some points are out of reach. Each counter-example was evaluated.

# %%
far = gt.certify.study(inverse, {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 2.5]]}, max_boxes=4000)
print(far.claims["status OK"], far.counter_examples[0])
print(f"proved {far.proved:.3f}, refuted {far.refuted:.3f}, undecided {far.undecided:.3f} of the volume")
assert far.proved + far.refuted + far.undecided == 1.0
far.figure()

# %% [markdown]
# The largest box of a shape that is proved, without a singular pose:

# %%
largest = gt.certify.study(
    inverse, {"T": [[-0.1, 1.3], [-1.5, -0.3], [-0.3, 1.1]]}, around={"T": [0.4, -0.9, 0.3]}, regular=True
)
print(largest.box, largest.least_singular_value)
assert largest.proved == 1.0

# %% [markdown]
# ## 3 Forces
#
# The range of the inverse dynamics over poses, velocities and accelerations is an upper bound of the motor forces of
# every motion in the box. It is larger than the largest force of any sample, since the box of a velocity and an
# acceleration is more than what a motion uses at once, and since intervals lose some of what operands have in common.

# %%
motion = {**box, "der(T)": [[-0.5, 0.5]], "der(T,2)": [[-2.0, 2.0]]}
dynamics = robot.causal(known="T", targets="tau")
forces = gt.certify.study(dynamics, motion)
rates = np.random.default_rng(2).uniform(-1.0, 1.0, (20_000, 6)) * [0.5, 0.5, 0.5, 2.0, 2.0, 2.0]
tau, _ = dynamics(T, rates[:, :3], rates[:, 3:])
for k, (name, (a, b)) in enumerate(forces.ranges.items()):
    print(f"{name}: proved {a:.0f} to {b:.0f} N, sampled {tau[:, k].min():.0f} to {tau[:, k].max():.0f} N")
    assert a <= tau[:, k].min() and tau[:, k].max() <= b

# %% [markdown]
# ## 4 Newton's method
#
# The six links of the D1 have no closed form. The Krawczyk operator proves that there is exactly one solution near the
# declared assembly mode; Kantorovich's bound that the code reaches it: from its last answer, if the tool moved at most
# 1 m/s for 4 ms, every step is accepted, and the answer is right to some 1e-13 m. The box is that of the controller,
# 0.6 m wide.

# %%
six = gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets="q")
wide = {"T": [[-1.76, -1.16], [-4.79, -4.19], [-0.28, 0.32]]}
moving = gt.certify.InputSpeed(speed={"T": 1.0}, period=0.004)
newton = gt.certify.study(six, wide, moving=moving, regular=True)
print(newton.boxes, newton.steps, max(newton.errors.values()), newton.least_singular_value)
assert newton.proved == 1.0 and max(newton.errors.values()) < 1e-12 and newton.least_singular_value > 0.1

# %% [markdown]
# ## Answer
#
# Ten thousand right answers say nothing about the point between two of them. One box says it of all points, under
# assumptions that fit on a page: `print(proof)` lists them.
#
# `gtmodel certify problems/certificate_l1.toml` does the same from a file; `gtmodel codegen --certify` writes a
# certificate beside the C code, with a checker that needs nothing of gtmodel.
