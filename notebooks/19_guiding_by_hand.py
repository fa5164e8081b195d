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
# # Guiding by hand
#
# **A person guides a tool over a plate of unknown stiffness. How is a force of 2 N held, without oscillation, and
# without hurting the hand?**
#
# The robot has two force sensors, one at the handle and one at the tool. All contacts, sensors and hands here are
# synthetic, with stated seeds.

# %%
# %matplotlib inline
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt

L = gt.control.lead_through

# %% [markdown]
# ## 1 What a sensor reads without contact
#
# Bias and weight are calibrated from 24 poses at rest. Without this calibration, the weight of a tool of 0.8 kg looks
# like a contact force of 8 N.

# %%
tool = L.SyntheticSensor(
    mass=0.8, centre=(0.004, 0.0, 0.07), point=(0.0, 0.0, 0.18), force_bias=(2.0, -1.0, 0.5), force_noise=0.05
)
calibration = L.wrench_study(L.SyntheticReadings(tool, repetitions=0, seed=1))
print(calibration)
assert calibration.mass is not None and abs(calibration.mass - 0.8) < calibration.half_widths["mass"] * 2

# %% [markdown]
# ## 2 The limit
#
# In contact, servo, delay and stiffness close a loop whose gain is K times the stiffness. The eigenvalues give the loop
# gain at which the loop oscillates; simulations in the time domain confirm it.

# %%
servo = L.ServoChain()  # 12 ms of lag, 8 ms of delay
limit = gt.control.delayed.gain_limit(L.force_loop(servo))
gain, frequency = L.simulated_limit(L.SurfaceGains(), servo, limit.gain)
print(f"eigenvalues: {limit.gain:.1f} 1/s at {limit.frequency:.1f} Hz; runs: {gain:.1f} 1/s at {frequency:.1f} Hz")
assert abs(gain / limit.gain - 1) < 0.05 and abs(frequency - limit.frequency) < 2

# %% [markdown]
# ## 3 Two newtons, from cardboard to plate
#
# The stiffest expected contact determines K. On softer contacts the loop is slower, but never unstable.

# %%
down, along = L.GuidePhase(1.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(6.0, force=(5.0, 0.0, -3.0))
stiffness = L.StiffnessRange(softest=500.0, stiffest=5000.0, share=0.4)
held = {}
for k in (500.0, 1500.0, 5000.0):
    held[k] = L.study(
        L.SyntheticSurface(k, tilt=np.deg2rad(4.0)), [down, along], stiffness=stiffness, tool=tool, hands=None
    )
    study = held[k]
    off = np.rad2deg(study.normal_error)
    print(f"{k:g} N/m: {study.mean_force:.3f} N, {study.contact_losses} losses, error of the normal {off:.2f} deg")
    assert study.status.ok

# %%
figure = held[5000.0].figure("force")
figure

# %% [markdown]
# ## 4 A plate stiffer than declared
#
# The plate is ten times stiffer than the declared range, so the loop gain is four times its limit. The watch detects
# the oscillation by the energy of the force above 5 Hz, and reduces the gain until the oscillation stops.

# %%
slow = [L.GuidePhase(2.0, force=(0.0, 0.0, -0.3)), L.GuidePhase(4.0, force=(0.5, 0.0, -3.0))]
plate = L.SyntheticSurface(50_000.0)
runs = {}
for name, watch in (("not watched", L.OscillationWatch()), ("watched", L.OscillationWatch(level=0.5))):
    runs[name] = L.study(plate, slow, stiffness=stiffness, tool=tool, hands=None, watch=watch)
    late = runs[name].run.force[1000:, 2]
    share = runs[name].gain_share
    print(f"{name}: {late.mean():.2f} N, standard deviation {late.std():.2f} N, share of the gain {share:.3f}")
assert runs["watched"].run.force[1000:, 2].std() < 0.3 < 3 < runs["not watched"].run.force[1000:, 2].std()

# %%
figure = Figure(figsize=(7.5, 3.2), layout="constrained")
axes = figure.subplots()
for name, one in runs.items():
    axes.plot(one.run.time, one.run.force[:, 2], label=name, linewidth=0.7)
axes.set(xlabel="time [s], synthetic", ylabel="force [N]")
axes.legend()
figure

# %% [markdown]
# ## 5 The hand
#
# A stiff hand closes a loop too. The eigenvalues are computed over a range of hands. In addition, the energy at the
# handle is balanced over every window of a run: the hand may only get back energy that was stored before.

# %%
stability = L.hand_stability(L.SurfaceGains(), servo, L.HandRange(stiffness=(0.0, 800.0)))
print(f"least damping ratio {stability.least:.2f}; stable up to {stability.stiffness_limit:.0f} N/m")
book = held[5000.0].book
print(book)
assert stability.stable and book.deficit < 1e-3 * book.passed

# %%
figure = held[5000.0].figure("energy")
figure

# %% [markdown]
# ## 6 A peg
#
# A peg is inserted 5 degrees off the axis of its hole. The contact torque turns it until the torque vanishes. No
# contact holds the peg about its own axis, so this rotation can be locked.

# %%
gains = L.SurfaceGains(
    force_gain=0.002, any_direction=True, force_reference=0.0, enter_force=0.3, leave_force=0.05, least_force=0.05,
    normal_filter=0.0, dwell=0.02, contact_arm=0.01,
)  # fmt: skip
fine = L.SyntheticSensor(mass=0.3, point=(0.0, 0.0, 0.1), force_noise=0.005, moment_noise=0.0002)
hole = L.SyntheticHole(tilt=np.deg2rad(5.0), clearance=0.25e-3, depth=0.08, stiffness=5000.0, friction=0.1)
push = [L.GuidePhase(10.0, force=(0.0, 0.0, -1.0)), L.GuidePhase(5.0)]
grip = replace(fine, force_noise=0.05)
pegs = {}
for about in ("free", "lock"):
    turning = L.TurningGains(torque_gain=1.0, about_axis=about)
    pegs[about] = L.study(hole, push, gains, turning, tool=fine, handle=grip, hands=None)
    peg = pegs[about]
    begin, end = np.rad2deg(peg.misalignment)
    print(f"{about}: misalignment {begin:.2f} to {end:.2f} deg, torque {1e3 * peg.largest_torque:.1f} to "
          f"{1e3 * peg.last_torque:.2f} mN m, own rotation {np.rad2deg(peg.turned_about):.5f} deg")  # fmt: skip
    assert peg.last_torque < 0.05 * peg.largest_torque
print("undetermined direction:", pegs["free"].undetermined)

# %%
figure = pegs["free"].figure("peg")
figure

# %% [markdown]
# ## Answer
#
# The stiffest expected contact sets the gain, at 0.4 of the limit for that contact. The 2 N are then held on all softer
# contacts, also on a tilted surface. On a plate beyond the declared range the force oscillates for a moment, the watch
# detects it, and the gain falls. All hands up to 800 N/m are stable; the loop would tolerate 4.9 kN/m. In no window of
# the run did the hand get back more energy than was stored.
