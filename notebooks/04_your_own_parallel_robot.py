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
# # Your own parallel robot
#
# **Can I build a closed-chain robot from parts, and trust what comes out?**
#
# The robot is a hexapod: a plate on six legs of variable length. Libraries that model robots as trees of joints do not
# accept it. Here it is a list of parts and connections. The dimensions are examples, not those of a real machine.

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import gtmodel as gt
from gtmodel.mechanics import Anchor, AnyQuaternion, RigidPlate, Strut

# %% [markdown]
# ## 1 The parts
#
# The model has six anchors on the ground, six struts, and one rigid plate with six joints. `connect` makes positions
# equal and forces balance. No kinematics is written by hand.

# %%
around = np.radians([-10, 10, 110, 130, 230, 250])
FEET = np.column_stack([np.cos(around), np.sin(around), 0 * around])
turned = np.radians([-50, 50, 70, 170, 190, 290])
JOINTS = 0.5 * np.column_stack([np.cos(turned), np.sin(turned), 0 * turned])
MASS, CENTRE = 6.0, np.array([0.02, -0.01, 0.05])


class Hexapod(gt.Model):
    """A plate on six struts: position r and quaternion e of the plate, leg lengths L, leg forces."""

    r = gt.variable(3, unit="m", start=[0.0, 0.0, 1.0], prefer=1)
    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0])
    L = gt.variable(6, unit="m", start=1.2)
    force = gt.input(6, unit="N")
    foot = gt.parts(6, Anchor, r=FEET)
    strut = gt.parts(6, Strut)
    plate = gt.part(RigidPlate, m=MASS, c=CENTRE, I=np.diag([0.1, 0.12, 0.2]), B=JOINTS)

    def equations(self):
        for i, strut in enumerate(self.strut):
            yield gt.connect(self.foot[i].point, strut.a)
            yield gt.connect(strut.b, self.plate.point[i])
            yield self.L[i] == strut.length
            yield self.force[i] == strut.force
        yield self.plate.frame.r == self.r
        yield self.e == self.plate.attitude.e


# %% [markdown]
# ## 2 From a pose to leg lengths and forces
#
# The pose is known, so everything has a closed form, without iteration. (A known quaternion needs no equation for its
# norm, so the plate takes `AnyQuaternion`, which has none.)

# %%
inverse = Hexapod(plate=dict(attitude=AnyQuaternion)).causal(["r", "e"], ["L", "force", "plate.frame.R"])
kinds = sorted({b.kind for b in inverse.plan.blocks})
print(kinds)
assert "Newton" not in kinds

pose = {"r": np.array([0.1, 0.05, 0.95]), "e": np.array([0.98, 0.1, -0.15, 0.08])}
pose["e"] /= np.linalg.norm(pose["e"])
arguments = [pose[s.name] if s.name in pose else np.zeros(s.shape) for s in inverse.inputs]  # at rest
L, force, R, status = inverse(*arguments)
print("lengths [m]", L.round(4))
print("leg forces [N]", force.round(2))

# %% [markdown]
# The cross-check computes the leg vectors by plain geometry, and tests that the six leg forces carry the weight and its
# moment.

# %%
legs = pose["r"] + JOINTS @ R.T - FEET
assert status == gt.Status.OK
assert np.allclose(L, np.linalg.norm(legs, axis=1), rtol=1e-12)
unit = legs / L[:, None]
wrench = np.vstack([unit.T, np.cross(JOINTS @ R.T, unit).T]) @ force
weight = np.array([0.0, 0.0, MASS * 9.81])
assert np.allclose(wrench, np.concatenate([weight, np.cross(R @ CENTRE, weight)]), atol=1e-9)

# %% [markdown]
# ## 3 From leg lengths to the pose
#
# A set of leg lengths has forty complex solutions for the pose, so there is no closed form. The compiler leaves one
# Newton block, which follows the solution from the home pose. The status shows when it fails.

# %%
forward = Hexapod().causal("L", ["r", "e"])
print("\n".join(line for line in forward.explain().splitlines() if "Newton" in line))
r, e, status = forward(L)
assert status == gt.Status.OK
assert np.allclose(r, pose["r"], atol=1e-10)
assert np.allclose(e * np.sign(e[0]), pose["e"], atol=1e-10)  # -e is the same orientation

_, _, status = forward(np.full(6, 0.2))  # shorter than the distance to any plate joint
print(status.name, "-", forward.diagnose(np.full(6, 0.2)))
assert status != gt.Status.OK

# %% [markdown]
# ## 4 What it looks like

# %%
figure = Figure(figsize=(5, 5), layout="constrained")
axes = figure.add_subplot(projection="3d")
corners = pose["r"] + JOINTS @ R.T
for foot, corner in zip(FEET, corners, strict=True):
    axes.plot(*np.column_stack([foot, corner]), color="0.3")
axes.plot(*np.vstack([corners, corners[:1]]).T, color="#0072b2")
axes.plot(*FEET.T, "s", color="black")
axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title="hexapod (example dimensions)")
axes.set_aspect("equal")
for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
    axis.set_major_locator(MaxNLocator(4))
figure

# %%
assert np.allclose(np.linalg.norm(corners - FEET, axis=1), L, rtol=1e-12)

# %% [markdown]
# ## Answer
#
# Yes. Parts and connections are enough. Leg lengths and forces from the pose, and the pose from the leg lengths, agree
# with plain geometry and statics, and a status marks data without a solution.
