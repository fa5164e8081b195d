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
# A task is also any function that returns numbers, here one of this notebook: a mass of 20 kg under a constant load of
# 220 N that moves 0.4 m at full force and is stopped by full force.


# %%
def loaded_mass(force: float) -> dict[str, float]:
    speeding, braking = (force - 220) / 20, (force + 220) / 20  # m/s2
    return {"time_s": float(np.sqrt(2 * 0.4 * (1 / speeding + 1 / braking)))}


simple = gt.sweep.study(loaded_mass, {"force": forces}, workers=2)
of_mass = np.diff(np.log(simple.table["time_s"])) / np.diff(np.log(forces))
print(of_mass.round(2))
assert swept.rows_solved == len(forces)
assert np.all(np.diff(exponent) > 0) and exponent[0] < -1.0 and -0.65 < exponent[-1] < -0.5
assert np.abs(exponent - of_mass).max() < 0.15

# %% [markdown]
# ## Answer
#
# Weak motors gain most: near 300 N gravity and friction take about 220 N of the force, and a third more force saves
# 30 % of the time. At 1,000 N the law of the free mass nearly holds: the exponent approaches -1/2.
