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
# # From excitation to feedforward
#
# **How must a robot move for its masses and friction to be identified, and what are they worth to its controller?**
#
# The robot is the L1 prototype (Dressler 2012, section 6.2) with masses and friction of Table 6.3, model 2, and link
# masses of our own: thirteen parameters. All logs are synthetic; the code states seeds and noise.

# %%
# %matplotlib inline
import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.control import Feedback, Feedforward, track
from gtmodel.identify import LogSimulator, Processing, Regressor, Sensors, identify, rows_of
from gtmodel.identify.excitation import (
    FINER,
    ExcitationTask,
    FourierSeries,
    condition,
    optimise_excitation,
    predicted_deviations,
    random_excitations,
    singular_values,
)
from gtmodel.measurements import Session
from gtmodel.plot.identification import efforts_figure, information_figure, path_figure
from gtmodel.plot.signals import signals_figure

NAMES = ["m_p", "m_c", "m_a", "viscous", "coulomb"]
SAMPLE_S, PERIOD_S, PERIODS, NOISE_N = 0.004, 4.0, 3, 30.0


def l1(velocity_scale, **parameters):
    """The robot; its friction changes sign over `velocity_scale` [m/s]."""
    links = {"m_a": [0.5, 1.0, 1.5]} | parameters
    return gt.robots.gantry_tau("l1_tape", "model_2", velocity_scale=velocity_scale, **links)


# %% [markdown]
# ## 1 Excitation
#
# The tool centre point follows a Fourier series of five harmonics that begins and ends at rest. Forces, speed and a box
# are limits. Forces and regressor are causalities of the same model. The optimised motion competes with a hundred
# random motions, each scaled up to the limits, and the search starts from the best of them.

# %%
x = [ca.SX.sym(n, 3) for n in ("T", "dT", "ddT")]
forces = l1(0.02).causal("T", "tau").casadi(*x)[0]
rows = ca.Function("rows", x, [ca.vertcat(x[0], ca.sumsqr(x[1]), forces)])
low, high = np.array([0.5, -1.15, 0.1]), np.array([1.5, -0.45, 0.9])
smooth, sharp = (Regressor(l1(scale), NAMES, known="T") for scale in (0.02, 1e-6))
task = ExcitationTask(
    FourierSeries(PERIOD_S, 5),
    rows,
    low=np.r_[low, -np.inf, -700.0 * np.ones(3)],
    high=np.r_[high, 1.5**2, 700.0 * np.ones(3)],
    regressor=ca.Function("Y", x, [smooth.casadi(*x)[0]]),
    nominal=smooth.nominal,
    criterion="variance",
)
place = np.array([0.8, -1.0, 0.3]), np.array([1.2, -0.6, 0.7])
draws = random_excitations(task, place, 100, seed=1)

# %%
times = np.arange(0.0, PERIOD_S, SAMPLE_S)
true_sign = ca.Function("Y", x, [sharp.casadi(*x)[0]])


def stacked(c):
    return task.stacked(c, times, true_sign)


conditions = np.array([condition(stacked(c), task.nominal) for c in draws])
best = draws[int(np.argmin(conditions))]
found = optimise_excitation(task, best)
print(f"{found.status}, {found.iterations} iterations; largest violation of a limit on a grid {FINER} times as fine: "
      f"{found.excess.max():.1e}")  # fmt: skip
print(f"condition number {condition(stacked(found.c), task.nominal):.0f}, best random {conditions.min():.0f}, "
      f"median {np.median(conditions):.0f}")  # fmt: skip
assert found.feasible and conditions.min() > 2 * condition(stacked(found.c), task.nominal)

# %%
motions = {"optimised": found.c, "best random": best}
_, cosine, sine = task.basis.amplitudes(found.c)
information_figure(
    {name: singular_values(stacked(c), task.nominal) for name, c in motions.items()},
    smooth.names,
    {name: predicted_deviations(stacked(c), NOISE_N) / np.sqrt(PERIODS) / task.nominal for name, c in motions.items()},
    amplitudes=np.hypot(cosine, sine),
    frequency=1 / PERIOD_S,
    title="information in the motions",
)

# %%
ends = [f"arm[{i}].rod.{end}.r" for end in "ab" for i in range(3)]
*joints, _ = l1(0.02).causal("T", ends)(task.motion(found.c, times, 1)[0][0])
paths = {name: task.motion(c, times, 1)[0] for name, c in motions.items()}
path_figure(paths, np.array(joints[:3]), np.array(joints[3:]), box=np.array([low, high]), title="paths")

# %% [markdown]
# ## 2 Identification
#
# Each motion is recorded for twelve seconds, with positions quantised to a micrometre and 30 N of noise on the forces.
# The same zero-phase filter acts on positions, forces and regressor.

# %%
inverse = l1(0.02).causal("T", "q")
regressor = Regressor(l1(1e-6), NAMES, known="q")


def log(c, seed):
    T = np.tile(task.motion(c, times, 1)[0], (PERIODS, 1))
    return LogSimulator(l1(1e-6), inverse(T)[0], SAMPLE_S).draw(seed, Sensors(effort_noise=NOISE_N))


def prepared(c, seed):
    return rows_of(Session("synthetic", log(c, seed), SAMPLE_S), regressor, Processing())


print(log(found.c, 1).synthetic)
models = {name: identify(prepared(c, 1), nonnegative=False, confidence="white") for name, c in motions.items()}
print(f"{'':12s}{'true':>8s}{'optimised':>20s}{'best random':>20s}")
for k, name in enumerate(regressor.names):
    shown = [f"{m.estimate.value(name):10.2f} +- {1.96 * m.estimate.std[k]:6.2f}" for m in models.values()]
    print(f"{name:12s}{regressor.nominal[k]:8.2f}{shown[0]:>20s}{shown[1]:>20s}")

# %%
ratio = models["best random"].estimate.std / models["optimised"].estimate.std
masses = slice(0, 7)
print("standard deviations, random motion over optimised motion:", np.round(ratio, 1))
# rounding errors decide which local optimum the search finds; from the five best draws the ratio was 1.5 to 3.6
assert np.all(ratio[masses] > 1.4) and np.exp(np.mean(np.log(ratio[masses]))) > 2

# %% [markdown]
# ## 3 Validation
#
# The held-out motion is another of the random ones.

# %%
identified = models["optimised"]
held_out = prepared(draws[7], 2)
print(identified.validate(held_out).message)
efforts_figure(held_out.time, held_out.effort, identified.modelled(held_out), held_out.targets, "N",
               "measured and modelled force, synthetic log, seed 2")  # fmt: skip

# %% [markdown]
# ## 4 Feedforward
#
# The same plant runs under a feedback of 40 N/mm in three variants: without feedforward, with forces of model 1 of
# Table 6.3 (no viscous friction, no link masses), and with forces of the identified model.

# %%
values = dict(zip(regressor.names, identified.parameters, strict=True))
arrays = {name: [values[f"{name}[{i}]"] for i in range(3)] for name in NAMES[1:]}
gains = 4e4, 2e3
laws = {
    "feedback alone": Feedback(*gains),
    "model 1": Feedforward(gt.robots.gantry_tau("l1_tape", "model_1", velocity_scale=0.02), *gains),
    "identified": Feedforward(l1(0.02, m_p=values["m_p"], **arrays), *gains),
}
t = np.linspace(0.0, 1.0, 51)
centre = np.array([1.0, -0.8, 0.5])
T = centre + 0.12 * np.sin(np.pi * t)[:, None] ** 4 * [1.0, -0.6, 0.8]
reference = gt.Trajectory(t, {"q": inverse(T)[0]}, {"q": "m"})
start = {"T": centre, "der(T)": np.zeros(3)}
runs = {name: track(l1(0.02), law, reference, start) for name, law in laws.items()}
rms = {name: 1e3 * np.max(run.rms) for name, run in runs.items()}
for name, value in rms.items():
    print(f"{name:15s} {value:.4f} mm rms")
assert rms["feedback alone"] > 2 * rms["model 1"] and rms["model 1"] > 20 * rms["identified"]

# %%
errors = {f"error_{name.replace(' ', '_')}": run.error for name, run in runs.items()}
signals_figure(gt.Trajectory(t, errors, dict.fromkeys(errors, "m"), title="tracking errors of the carts"))

# %% [markdown]
# ## Answer
#
# The robot should move, within its limits, so that the sum of the relative variances is smallest. Compared with the
# best of a hundred random motions, the condition number halves, and the confidence intervals of the masses shrink to
# two fifths on average, to two thirds at worst. Both motions determine the friction. The link masses remain the least
# certain, but on a held-out motion the modelled forces are right to two per cent. Feedforward with the identified model
# leaves a hundredth of the tracking error of model 1, and less than a three-hundredth of the error of feedback alone.
