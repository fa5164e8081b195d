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
# # Units that work together
#
# **Does the loop of Fig. 3.2 still work when all that is left of model, controller and robot are three archives?**
#
# In Dressler 2012, Fig. 3.2, an inverse model with filters runs beside the controller: the reference goes in, the motor
# forces come out that move the carts along the filtered reference; feedback only takes what the model does not know.
# Here each of the three becomes a functional mock-up unit (FMI), as a test bench or another simulator would take it,
# and a few lines that know nothing of gtmodel's equations run them together.

# %%
# %matplotlib inline
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt
from gtmodel.robots.inverse_model import InverseModel

H = 1e-3  # of the controller, s
place = Path(tempfile.mkdtemp())
model = gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1)
# 1 kg that the model does not know
robot = gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1, payload=1.0)

# %% [markdown]
# ## 1 Three archives
#
# The robot has states T and der(T); the inverse model has three lags for each cart, which make it causal; the
# controller is a sampled block. Each is compared with the function it was made from, bit for bit, and FMPy's validator
# reads it.

# %%
HOME = [1.3, -0.5, 0.9]
q0, _ = model.causal(known="T", targets="q")(HOME)
plant = gt.fmu.export(
    robot.causal(known="tau", targets=["q", "der(q)"], prefer="T"), place / "robot.fmu", start={"T": HOME}, stop=0.2
)
inverse = gt.fmu.export(
    InverseModel(robot=model).causal(known="reference", targets=["tau", "robot.q", "der(robot.q)"]),
    place / "inverse.fmu",
    start={f"filter[{k}].x": [q0[k]] * 3 for k in range(3)},
    stop=0.2,
)


class Feedback(gt.SampledBlock):
    """Forces of the model, plus a spring and a damper to the filtered reference."""

    stiffness = gt.parameter(20_000.0, unit="N/m")
    damping = gt.parameter(400.0, unit="N.s/m")
    model = gt.input(3, unit="N")
    error = gt.input(3, unit="m")
    rate = gt.input(3, unit="m/s")
    force = gt.output([0.0, 0.0, 0.0], unit="N")

    def step(self, inputs, state):
        return {"force": inputs.model + self.stiffness * inputs.error + self.damping * inputs.rate}


class Desk(gt.Model):
    """Where the block stands while it is made into a unit: inputs from nowhere."""

    model = gt.input(3, unit="N")
    error = gt.input(3, unit="m")
    rate = gt.input(3, unit="m/s")
    law = gt.part(Feedback, period=H)

    def equations(self):
        yield self.law.model == self.model
        yield self.law.error == self.error
        yield self.law.rate == self.rate


law = gt.fmu.export(gt.cgen.BlockFunction(Desk(), "law"), place / "law.fmu")
for unit in (plant, inverse, law):
    report = gt.fmu.check(unit, points=100)
    passed = sum(c.passed for c in report.checks.values())
    print(f"{unit.table.name}.fmu: {len(unit.data)} bytes, {passed} of {len(report.checks)} checks")
    assert all(c.passed for c in report.checks.values())

# %% [markdown]
# ## 2 The loop
#
# Reference, inverse model, controller, robot: names of variables are all that the master knows. The reference moves the
# carts by 5 cm within 0.2 s. The inverse model is stepped ten times as often as the controller: a reference that is
# held over a whole period would meet its lags always at the same phase, which bends the forces.


# %%
def reference(t):
    s = np.clip(t / 0.2, 0.0, 1.0)
    return q0 + 0.05 * np.array([1.0, -0.6, 0.4]) * s**3 * (10 - 15 * s + 6 * s**2)


def three(name):
    return [f"{name[:-1]}[{k}])" if name.endswith(")") else f"{name}[{k}]" for k in (1, 2, 3)]


def run(feedforward: bool, feedback: bool, seconds: float = 0.5):
    """Times, filtered reference and carts."""
    i, c, p = (gt.fmu.RunningUnit(u) for u in (inverse, law, plant))
    rows = []
    for n in range(round(seconds / H)):
        wanted, speed = i.get(three("robot.q")), i.get(three("der(robot.q)"))
        q, dq = p.get(three("q")), p.get(three("der(q)"))
        rows.append([n * H, *wanted, *q])
        holding = i.get(three("tau")) if feedforward else np.zeros(3)
        c.set(three("model"), holding)
        c.set(three("error"), (wanted - q) if feedback else np.zeros(3))
        c.set(three("rate"), (speed - dq) if feedback else np.zeros(3))
        c.step(H)
        p.set(three("tau"), c.get(three("force")))
        p.step(H)
        for k in range(10):
            i.set(three("reference"), reference((n + (k + 0.5) / 10) * H))
            i.step(H / 10)
    return np.array(rows)


runs = {
    "feedback alone": run(False, True),
    "model alone": run(True, False),
    "both": run(True, True),
}
worst = {name: 1e3 * np.max(np.abs(rows[:, 1:4] - rows[:, 4:7])) for name, rows in runs.items()}
for name, error in worst.items():
    print(f"{name}: at most {error:.2f} mm beside the filtered reference")
assert worst["both"] < 0.2 * worst["feedback alone"] and worst["both"] < 0.5 * worst["model alone"]

# %%
figure = Figure(figsize=(7.5, 3.4), layout="constrained")
axes = figure.subplots()
for name, rows in runs.items():
    axes.semilogy(rows[:, 0], 1e3 * np.max(np.abs(rows[:, 1:4] - rows[:, 4:7]), axis=1) + 1e-4, label=name)
axes.set(xlabel="time [s]", ylabel="worst cart beside the filtered reference [mm]", title="L1, three units (synthetic)")
axes.legend()
figure

# %% [markdown]
# ## 3 Where it ends
#
# A unit never gives a number that is none. Pushed out of its workspace the robot's unit refuses the step.

# %%
unit = gt.fmu.RunningUnit(plant)
unit.set(["tau[1]"], [4000.0])
said = ""
for _ in range(2000):
    try:
        unit.step(0.004)
    except gt.fmu.UnitStopped as stopped:
        said = str(stopped)
        break
print(said)
assert "stopped between" in said

# %% [markdown]
# ## 4 The robot's unit in the 4 ms loop
#
# The same archive can be what the C loop of a controller moves: the program is built with the model's functions and
# talks EGM over datagrams to a simulated controller, behind which the unit stands. A servo, 40,000 N/m, makes forces of
# the commanded positions. The law `dynamics` knows the servo and the model, not the 1 kg.

# %%
functions = {"fk": model.causal(known="q", targets="T"), "inverse_dynamics": model.causal(known="T", targets="tau")}
gt.cgen.study(functions, place / "code", name="l1", check=None)
s = np.arange(151)[:, None] / 150
seconds, way = 0.6, np.array([0.15, -0.2, 0.1])
motion = gt.Trajectory(
    0.004 * np.arange(151),
    {
        "T": np.array(HOME) + (10 * s**3 - 15 * s**4 + 6 * s**5) * way,
        "der(T)": (30 * s**2 - 60 * s**3 + 30 * s**4) * way / seconds,
        "der(T,2)": (60 * s - 180 * s**2 + 120 * s**3) * way / seconds**2,
    },
    {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2"},
)
moved = gt.fmu.PlantUnit(plant, three("q"), force=three("tau"), speed=three("der(q)"))
loop = gt.loop.study(
    model, place / "code", motion, peer="egm", seconds=1.6, law="dynamics", in_lockstep=True, plant=moved
)
off, on = (run["tcp_rms_mm"] for run in loop.runs)
print(f"{loop.plant}: rms error {off:.1f} mm by the reference alone, {on:.1f} mm with the model")
assert loop.status.ok and on < 0.5 * off

# %%
loop.figure("tracking")

# %% [markdown]
# ## Answer
#
# Yes. Three archives of 40 to 60 kB, run by a master that knows names only, do what the block diagram says: model and
# feedback together stay nearer to the filtered reference than either alone, with a robot that is 1 kg
# heavier than its model. And the archive of the robot is good enough a robot for the controller's own C program.
