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
# # When to believe a filter
#
# **A filter gives deviations with its estimates. When do they mean something?**
#
# A laser tracker reads the position of a tool, an inertial unit its acceleration. All readings here are synthetic, so
# that the truth is known; the tests that follow do not need it.

# %%
# %matplotlib inline
import numpy as np

import gtmodel as gt

F = gt.filtering
body = F.TranslatingBody(gravity=[0.0, 0.0, 0.0])
process = F.ProcessModel(body, noise={"jerk": 0.1}, states=["p", "v", "a"])  # white jerk, 0.1 m2/s5
sensors = [F.Sensor("tracker", "p", deviation=6.4e-6), F.Sensor("accelerometer", "specific_force", deviation=0.0123)]
system = F.System(process, sensors)
start = F.InitialState({"v": [0.042, 0.0, 0.0]}, {"p": 1e-4, "v": 1e-2, "a": 0.1})
time = 0.001 * np.arange(1000)

# %% [markdown]
# ## 1 A right filter
#
# Over a hundred independent runs the errors, squared in the filter's own deviations, have a mean that is known exactly:
# so many as there are states, within a narrow band.

# %%
drawn = F.draw(system, start, time, seed=1, runs=100)
runs = F.ErrorState(system).run(drawn.log, start, truth=drawn.truth)
errors = F.judged(runs)
print("errors squared, at ten instants:", errors.nees.round(2))
print("band of 99.9 %:", np.round(errors.band, 2))
print(errors.consistency.message)
assert errors.consistent

# %% [markdown]
# ## 2 A wrong one, without the truth
#
# On a machine there is one run and no truth. What the filter expects of the next reading is still there to be judged:
# the innovations. A filter that takes the tracker for ten times worse than it is has errors that look fine, and
# innovations that give it away.

# %%
one = F.draw(system, start, time, seed=2)
doubtful = system.with_(deviations={"tracker": 6.4e-5})
run = F.ErrorState(doubtful).run(one.log, start)
verdict = F.consistency(run)
print(verdict.message)
assert not verdict.consistent

tuned = F.tune(doubtful, one.log, start, ["tracker.deviation", "jerk.density"])
for name, factor in tuned.factors.items():
    low, high = tuned.intervals[name]
    print(f"the likelihood multiplies {name} by {factor:.3g} ({low:.3g} to {high:.3g})")
low, high = tuned.intervals["tracker.deviation"]
assert low < 0.1 < high
assert F.consistency(F.ErrorState(tuned.system).run(one.log, start)).consistent

# %% [markdown]
# ## 3 A fault with a name
#
# Somebody mounted the accelerometer with an offset of 0.02 m/s2. Each suspect is judged by how the innovations would
# depend on it. An offset of the tracker is no suspect that this log could convict: nothing else says where the tool is.

# %%
off = dict(one.log)
off["accelerometer"] = F.Readings(time, np.add(one.log["accelerometer"].values, [0.02, 0.0, 0.0]))
print(F.consistency(F.ErrorState(system).run(off, start)).message)
suspects = {"accelerometer.offset": 0.1, "accelerometer.scale": 0.5, "tracker.offset": 1e-5, "tracker.deviation": 1.0}
search = F.find_faults(process, sensors, off, start, suspects)
print(search.message)
assert search.named == ("accelerometer.offset",) and "tracker.offset" in search.unseen

# %% [markdown]
# ## 4 Where a right filter stops being right
#
# White jerk of one density describes the flanks of this sine, not its bend. The picture shows the instant at which the
# innovations leave their band; the deviations are not to be believed there.

# %%
study = F.fusion_study(filter=F.FusionFilter(smooth=True))
print(study)
study.figure("innovations")

# %%
study.figure("baselines")

# %%
bend = study.trajectory["at_bend"] > 0
ratio = study.trajectory["nis"] / study.nis_numbers
print(f"squares over expected: {ratio[~bend].mean():.2f} on the flanks, {ratio[bend].mean():.1f} at the bend")
assert ratio[bend].mean() > 2 > ratio[~bend].mean()

# %% [markdown]
# ## Answer
#
# Believe the deviations while the innovations agree with them: inside their band, white, and without a mean. That needs
# no truth, and it names an instant. Where they disagree, the likelihood says which noise fits, and the suspects which
# fault; what a motion does not show, no filter finds. Agreement on the average is not agreement everywhere: look at the
# bends.
