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
# # From a log to a verdict
#
# **What can be concluded about a robot from its log files?**
#
# The recording is of a real hexapod in front of a motion capture system (Jugglebot project, MIT licence): 108 poses,
# six leg readings in motor revolutions, a position and a quaternion. This notebook starts without any knowledge of the
# files. It inspects them, calibrates the robot, reads the verdict, and checks it against another recording. The last
# section covers two needs of motion logs: an even time grid, and the delay of a channel.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt

# %% [markdown]
# ## 1 Look first
#
# `gtmodel inspect FILE` prints the same. Information that the header does not contain is guessed, with the reason for
# each guess.

# %%
log = gt.measurements.inspect(gt.shipped("data/hexapod/108_calibration_poses.csv"))
print(log.message)
for note in log.notes:
    print("-", note)
assert any("quaternion" in note for note in log.notes)

# %% [markdown]
# ## 2 Fit
#
# The problem file states what each column measures, its unit and its standard deviation. `gt.load` turns the file into
# a call; calling it runs the study.

# %%
call = gt.load("calibrate_hexapod")
study = call()
print(study.message)
for name, errors in (("as drawn", study.a_priori), ("held out", study.held_out)):
    print(f"{name:>9s}: mean error {1e3 * errors['mean']:.2f} mm, largest {1e3 * errors['max']:.2f} mm")
assert study.held_out["mean"] < study.a_priori["mean"]

# %%
study.figure("pose_errors")

# %% [markdown]
# ## 3 Read the verdict
#
# Each sentence covers a different question: whether the numerics are sound, whether the confidence intervals of the
# parameters are valid, and how well the model predicts held-out poses.

# %%
for sentence in study.verdict:
    print("-", sentence)
assert study.numerics_sound and study.prediction_proven

# %% [markdown]
# ## 4 Another day
#
# The second recording shows the same robot on another day. The geometry stays as calibrated. The legs were homed again,
# and the frames of the capture system and of the markers differ, so six offsets and two frames are fitted to half of
# the poses and judged on the other half.

# %%
again = gt.load("judge_hexapod")()
print(again.message)
offsets = [u["value"] for u in again.unknowns if "offset" in u["name"]]  # motor revolutions
lengths = 1e3 * np.array(offsets) * call.arguments[0].c  # call.arguments[0] is the robot as drawn
print("offsets of the new homing:", ", ".join(f"{length:.2f}" for length in lengths), "mm of leg length")
assert again.held_out["mean"] < 3 * study.held_out["mean"]

# %% [markdown]
# ## 5 Logs of motion
#
# Logs have timing jitter, missing rows, and clocks of their own. These two recordings are synthetic: one motion, the
# second channel 3.04 ms late, a jitter of 30 %, and 2 % of the rows missing.

# %%
truth = gt.measurements.SyntheticDelay(delay=0.00304, jitter=0.3, missing=0.02, seed=4)
first, second = gt.measurements.made_pair(truth)
sampling = gt.measurements.sampling_of(first.time)
print(f"{sampling.rate:.1f} Hz, jitter {100 * sampling.jitter:.0f} %, {len(sampling.gaps)} gaps")
delay = gt.measurements.delay_study({"channel 2": (first, second)}, title="A late channel")
low, high = (1e3 * t for t in delay.interval("channel 2"))
print(f"late by {1e3 * delay.delay[0]:.3f} ms, 95 % interval {low:.3f} to {high:.3f} ms")
assert low < 1e3 * truth.delay < high

# %% [markdown]
# The delay, a fraction of a sampling period, is known to a hundredth of a period. After the delay is removed, the rows
# are resampled on an even grid. To bound the interpolation error, every other row is left out and predicted from the
# others.

# %%
fit = gt.measurements.align(first, second, drift=False, within=(-0.05, 0.05))
even = gt.measurements.resample(fit.bring(second), 0.004, longest_gap=0.1)
print(even.message)
print(f"prediction error {1e3 * even.error['q'][0]:.2f} mrad rms, including {1e3 * truth.noise:g} mrad of noise")
assert np.allclose(np.diff(even.trajectory.time), 0.004)

# %% [markdown]
# ## Answer
#
# For this hexapod: within the measured box, the model predicts positions with a mean error of a millimetre. That
# includes another day, once six offsets and two frames are fitted to some of its poses. For its individual parameters
# there are no confidence intervals, because the residuals are not white noise, and the verdict says so. For a late
# channel: its delay, to a hundredth of a sampling period, because its residuals are white.
