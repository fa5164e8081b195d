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
# # How strong must the motors be?
#
# **A motion takes some time with motors of 700 N. What do stronger motors gain?**
#
# A sweep solves one problem for many values of its keys, in worker processes or on a cluster, into one table. For a
# mass that a constant force moves over a given distance, the time is proportional to F^(-1/2): twice the force saves
# 29 % of the time. A robot with friction, gravity and coupled carts need not follow that law.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt

# %% [markdown]
# ## 1 The same problem for seven forces
#
# `workers=2` starts two processes; `None` starts one for each core. The table has the same bytes for any number. With
# `folder=` finished rows stay on the disk, and a call that was interrupted continues there.

# %%
problem = gt.load("sweep_force", "mesh.elements=10")
forces = [300, 400, 500, 600, 700, 850, 1000]
swept = gt.sweep.study(problem, {"limits.force_N": forces}, show=["final_time_s"], workers=2)
print(swept)

# %%
swept.figure("sweep")

# %% [markdown]
# ## 2 The exponent
#
# The slope of the logarithms is the exponent of the law, locally.

# %%
time = np.array(swept.table["final_time_s"])
exponent = np.diff(np.log(time)) / np.diff(np.log(forces))
for force, value in zip(forces, exponent, strict=False):
    print(f"from {force} N: {value:.2f}")

# %% [markdown]
# ## 3 Any function
#
# A task is also any function of a notebook that returns numbers. Here a mass of 20 kg with 60 N of friction moves 0.43 m
# from rest and is stopped by full force: the law without a robot, with friction in its place.


# %%
def mass_with_friction(force: float) -> dict[str, float]:
    speeding, braking = (force - 60) / 20, (force + 60) / 20  # m/s2
    return {"time_s": float(np.sqrt(2 * 0.43 * (1 / speeding + 1 / braking)))}


simple = gt.sweep.study(mass_with_friction, {"force": forces}, workers=2)
steps = np.diff(np.log(simple.table["time_s"])) / np.diff(np.log(forces))
print(steps.round(2))

# %% [markdown]
# ## The answer
#
# Stronger motors gain about as much as for a free mass, and slightly more at small forces, where friction and gravity
# take a larger share.

# %%
assert swept.rows_solved == len(forces)
assert np.all(np.diff(time) < 0)
print(exponent.round(3))
