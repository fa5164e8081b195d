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
# **A filter reports standard deviations with its estimates. When can they be trusted?**
#
# A laser tracker measures the position of a tool, an inertial unit its acceleration. All readings here are synthetic,
# so the truth is known; the tests from section 2 on do not need it.

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
# The squared error, normalised by the filter's own covariance, has a known mean over a hundred independent runs: the
# number of states, within a narrow band.

# %%
drawn = F.draw(system, start, time, seed=1, runs=100)
runs = F.ErrorState(system).run(drawn.log, start, truth=drawn.truth)
errors = F.judged(runs)
print("normalised squared errors at ten instants:", errors.nees.round(2))
print("band of 99.9 %:", np.round(errors.band, 2))
print(errors.consistency.message)
assert errors.consistent

# %% [markdown]
# ## 2 A wrong one, without the truth
#
# A machine gives one run and no truth. What remains to be tested are the innovations, the differences between the
# readings and the filter's predictions. A filter that assumes ten times the true noise of the tracker has errors that
# look fine, but its innovations reveal the mistake.

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
# The accelerometer now has an offset of 0.02 m/s2. Each suspect is tested by its effect on the innovations. This log
# cannot reveal an offset of the tracker, because no other sensor measures the position of the tool.

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
# White jerk of one density describes the flanks of this sine, but not its bends. The picture shows when the innovations
# leave their band; at these instants the standard deviations cannot be trusted.

# %%
study = F.fusion_study(filter=F.FusionFilter(smooth=True))
print(study)
study.figure("innovations")

# %%
study.figure("baselines")

# %%
bend = study.trajectory["at_bend"] > 0
ratio = study.trajectory["nis"] / study.nis_numbers
print(f"squared innovations over expected: {ratio[~bend].mean():.2f} on the flanks, {ratio[bend].mean():.1f} at bends")
assert ratio[bend].mean() > 2 > ratio[~bend].mean()

# %% [markdown]
# ## Answer
#
# Trust the standard deviations as long as the innovations agree with them: inside their band, white, and with zero
# mean. This test needs no truth, and it names the instants where it fails. If it fails, the likelihood shows which
# noise fits, and the list of suspects which fault. A fault that the motion does not excite cannot be found by any
# filter. Agreement on average is not agreement everywhere: look at the bends.
