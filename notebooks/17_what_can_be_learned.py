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
# # What can be learned
#
# **A robot repeats a motion, and the same error with it. How much of that can it unlearn, and how fast?**
#
# Iterative learning control corrects the reference with the errors of earlier runs (Dressler 2012, chapter 7). Both
# questions can be answered before the first iteration. The robot here is synthetic: motor loops, and a tool on a
# spring.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt

learning = gt.control.learning

# %% [markdown]
# ## 1 How fast
#
# The law is u(k+1) = Q (u(k) + L e(k)). Each run multiplies the distance of the input from its limit by at most the
# largest singular value of Q (I - L T). For the actuators of the thesis this gives its published numbers, 0.90, 0.91
# and 0.93.

# %%
law = learning.simple_law(825, gain=0.9, shift=5, cutoff=10.0)
loops = [learning.lifted(learning.delayed_lag(b, a, 5), 825) for b, a in learning.ACTUATORS]
sigma = [learning.largest_gain(law.map(T)) for T in loops]
print(np.round(sigma, 3))
assert np.allclose(sigma, [0.904, 0.907, 0.930], atol=5e-4)

# %% [markdown]
# With a lightly damped tool at 11.5 Hz, and with the low pass of Q above that mode, the same law would diverge. It is
# refused.

# %%
tool = learning.flexible_axis(11.5, 0.05).maps(825)["tool"]
try:
    learning.rate(learning.simple_law(825, gain=0.9, shift=5, cutoff=30.0), tool)
except gt.results.ArgumentError as error:
    print(error.message)
else:
    raise AssertionError

# %% [markdown]
# ## 2 How far
#
# Two parts of the error remain: the part that Q blocks, and the part that differs from run to run. A few identical runs
# show both. They predict the floor before learning, and the runs then reach it.

# %%
robot = learning.LearningRobot()
motors = learning.study(robot, title="learning from the motors, case 1 (synthetic)")
print(motors.message)
print("floor [um]", np.round(1e6 * np.array(motors.floor), 1), "reached", np.round(1e6 * np.array(motors.reached), 1))
assert np.allclose(motors.reached, motors.floor, rtol=0.2)
motors.figure("errors")

# %% [markdown]
# ## 3 What is learned from
#
# The motors follow the reference, but the tool on its spring does not: the crosses lie far above the dots. The law must
# know the position of the tool, from an accelerometer and a filter, or from a measurement. Q then stays below 1 / |1 -
# L T| for a whole set of tools.

# %%
studies = {"1": motors}
for case in ("2A", "2B", "3"):
    studies[case] = learning.study(
        robot, design=learning.LearningDesign(case=case), title=f"learning, case {case} (synthetic)"
    )
for case, study in studies.items():
    print(
        f"case {case:>2}: remaining tool error {100 * study.tool_share[0]:5.1f} % in x, "
        f"{100 * study.tool_share[1]:4.1f} % in y"
    )
remaining_errors = [study.tool_share[1] for study in studies.values()]
assert (
    remaining_errors[0] > remaining_errors[1] > remaining_errors[2] and remaining_errors[3] < 1.1 * remaining_errors[2]
)
assert max(max(study.bound) for study in studies.values()) < 1
studies["2B"].figure("filter")

# %%
studies["2B"].figure("errors")

# %%
studies["2B"].figure("path")

# %% [markdown]
# ## 4 What a wrong model costs
#
# The Kalman filter of (7.21) predicts the tool from the motors with a model, and corrects the prediction with the
# accelerometer. Its error depends on the frequency error of the model. A model that is identified from a log of random
# motion, with 1 um of noise, performs like the true one.

# %%
r = learning.SquarePath().samples(0.004)[:, 1]
run = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(825).items()}
run["acceleration"] = run["acceleration"] + 0.07 * np.random.default_rng(1).normal(size=825)
random = 1e-3 * np.repeat(np.random.default_rng(2).normal(size=400), 10)
log = {name: T(random) for name, T in learning.flexible_axis(11.5, 0.05).maps(4000).items()}
log["tool"] = log["tool"] + 1e-6 * np.random.default_rng(3).normal(size=4000)
models = {f"{100 * off:.0f} % off": learning.tool_model(11.5 * (1 + off), 0.05) for off in (0.0, 0.03, 0.1, 0.2)}
models["identified"] = learning.identified_tool(log["motor"], log["tool"], order=4)
errors = {"motors alone": run["motor"] - run["tool"]}
for name, model in models.items():
    kalman = learning.most_likely_filter(model, run["motor"], run["acceleration"], 0.07)
    errors[name] = learning.kalman_estimate(825, kalman)(run) - run["tool"]
rms = {name: 1e6 * float(np.sqrt(np.mean(e[100:725] ** 2))) for name, e in errors.items()}
for name, value in rms.items():
    print(f"{name:>12}: {value:5.1f} um")
assert rms["0 % off"] < rms["3 % off"] < rms["10 % off"] < rms["20 % off"] < rms["motors alone"]
assert rms["identified"] < rms["3 % off"]

# %% [markdown]
# ## Answer
#
# The robot can learn what repeats, what is measured, and what Q passes. The rate is the largest |Q| |1 - L T| over all
# robots in the assumed set. The floor follows from a few identical runs. Both were predicted before learning, and both
# predictions were confirmed. More iterations do not lower the floor; a better measurement of the tool does.
