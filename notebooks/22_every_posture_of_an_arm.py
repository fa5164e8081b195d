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
# # Every posture of an arm
#
# **In which postures can an arm hold its tool, and which of them can it keep along a whole seam?**
#
# An arm with six joints reaches a pose in up to eight postures, or sixteen without a special structure of its axes. A
# robot program needs one of them, and the same one from the first to the last point of a path.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt
from gtmodel.kinematics import ToolColumns, ToolPose, ToolPoses

# %% [markdown]
# ## 1 All postures of one pose
#
# The arm has the axes of a UR arm and comes from a URDF. The gripper points down; its orientation is written as KUKA
# writes it, A, B and C in degrees.

# %%
arm = gt.robots.from_urdf("problems/models/ur_like.urdf")
pose = ToolPose([0.40, 0.15, 0.10], [30.0, 0.0, 180.0], "KUKA A B C")
study = gt.kinematics.postures_study(arm, pose, near=np.radians([0, 90, -90, -90, -90, 0]))
print(study)
assert len(study.each) == 8 and all(p["within_limits"] for p in study.each)

# %%
study.figure("postures")

# %% [markdown]
# All eight return to the same pose. This check uses the forward kinematics, which the closed form has not seen:

# %%
T, R, status = arm.causal("q", ["T", "R"])(np.array([p["q"] for p in study.each]))
print("largest error", np.abs(T - pose.poses.T).max(), "m")
assert not status.any() and np.allclose(T, pose.poses.T, atol=1e-12) and np.allclose(R, pose.poses.R, atol=1e-12)

# %% [markdown]
# ## 2 A seam
#
# A synthetic seam runs along 300 degrees of a circle, with the tool tilted by 30 degrees. The arm has a spherical wrist
# and narrower limits. Which of its postures goes all the way?

# %%
welder = gt.robots.from_urdf("problems/models/arm.urdf")
columns = ToolColumns(["x", "y", "z"], "mm", ["A", "B", "C"], "KUKA A B C")
seam = gt.kinematics.read_tool_poses("problems/data/seam_synthetic.csv", columns)
way = gt.kinematics.postures_study(welder, seam, path=True, title="the seam")
print(way.message)
assert way.status.ok and np.abs(np.diff(way.chosen, axis=0)).max() < np.radians(30)
way.figure("path")

# %% [markdown]
# The dots are all postures within limits, the line is the way that the study takes. It does not begin at the joint
# coordinates nearest to zero: from there the flange would turn beyond its limit before the end. The study begins one
# turn higher.

# %%
nearest = gt.kinematics.postures_study(welder, ToolPoses(seam.T[:1], seam.R[:1])).chosen[0]
print("nearest:", np.degrees(nearest).round(0), " taken:", np.degrees(way.chosen[0]).round(0))
assert not np.allclose(nearest, way.chosen[0], atol=0.1)

# %% [markdown]
# ## 3 Where a jump is unavoidable
#
# With a flange that turns by 180 degrees to each side, no choice avoids a jump. The row before which the furthest
# of all ways ends, and the joint that stops it:

# %%
limits = welder.joint_limits.copy()
limits[5] = [-np.pi, np.pi]
chain = gt.kinematics.chain_of(welder)
every = gt.kinematics.postures(chain, seam.T, seam.R)
tight = gt.kinematics.along_path(chain, every, seam.T, seam.R, limits=limits)
for jump in tight.jumps:
    print(
        f"row {jump.row + 1}: {way.joints[jump.joint]} beyond its {jump.kind} by {np.degrees(jump.amount):.1f} degrees"
    )
assert len(tight.jumps) == 1 and tight.jumps[0].kind == "limit"

# %% [markdown]
# ## Answer
#
# The set of all postures is known in closed form, with names, and a search over this set finds the way along a path:
# here one without a jump, one turn away from the nearest start. Where none exists, one jump is the least, and its row
# and joint are known before the robot moves.
