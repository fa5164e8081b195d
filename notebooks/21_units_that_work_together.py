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
# In Dressler 2012, Fig. 3.2, an inverse model with filters runs next to the controller. Its input is the reference; its
# outputs are the motor forces that move the carts along the filtered reference. Feedback only corrects what the model
# does not predict. Here each of the three becomes a functional mock-up unit (FMI), as a test bench or another simulator
# would use it. A few lines of code, independent of gtmodel's equations, run them together.

# %%
# %matplotlib inline
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gtmodel as gt

H = 1e-3  # period of the controller [s]
place = Path(tempfile.mkdtemp())
model = gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1)
# the payload of 1 kg is unknown to the model
robot = gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1, payload=1.0)

# %% [markdown]
# ## 1 Three archives
#
# The robot has the states T and der(T). The inverse model has three lags for each cart, which make it causal. The
# controller is a sampled block. Each unit is compared bit for bit with the function it was generated from, and passes
# FMPy's validator.

# %%
HOME = [1.3, -0.5, 0.9]
q0, _ = model.causal(known="T", targets="q")(HOME)
plant = gt.fmu.export(
    robot.causal(known="tau", targets=["q", "der(q)"], prefer="T"), place / "robot.fmu", start={"T": HOME}, stop=0.2
)
inverse = gt.fmu.export(
    gt.robots.InverseModel(robot=model).causal(known="reference", targets=["tau", "robot.q", "der(robot.q)"]),
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
    """Wraps the block for the export: its inputs become inputs of the unit."""

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
# The master connects reference, inverse model, controller and robot by variable names only. The reference moves the
# carts by 5 cm within 0.2 s. The inverse model takes ten steps per controller period. A reference held constant over a
# whole period would always meet the lags at the same phase, which distorts the forces.


# %%
def reference(t):
    s = np.clip(t / 0.2, 0.0, 1.0)
    return q0 + 0.05 * np.array([1.0, -0.6, 0.4]) * s**3 * (10 - 15 * s + 6 * s**2)


def three(name):
    return [f"{name[:-1]}[{k}])" if name.endswith(")") else f"{name}[{k}]" for k in (1, 2, 3)]


def run(feedforward: bool, feedback: bool, seconds: float = 0.5):
    """Simulate the three units; return times, filtered reference and cart positions."""
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
    print(f"{name}: largest distance from the filtered reference {error:.2f} mm")
assert worst["both"] < 0.2 * worst["feedback alone"] and worst["both"] < 0.5 * worst["model alone"]

# %%
figure = Figure(figsize=(7.5, 3.4), layout="constrained")
axes = figure.subplots()
for name, rows in runs.items():
    axes.semilogy(rows[:, 0], 1e3 * np.max(np.abs(rows[:, 1:4] - rows[:, 4:7]), axis=1) + 1e-4, label=name)
axes.set(xlabel="time [s]", ylabel="largest tracking error of a cart [mm]", title="L1, three units (synthetic)")
axes.legend()
figure

# %% [markdown]
# ## 3 Where it ends
#
# A unit never returns NaN. Pushed out of its workspace, the robot's unit refuses the step.

# %%
unit = gt.fmu.RunningUnit(plant)
unit.set(["tau[1]"], [4000.0])
message = ""
for _ in range(2000):
    try:
        unit.step(0.004)
    except gt.fmu.UnitStopped as stopped:
        message = str(stopped)
        break
print(message)
assert "stopped between" in message

# %% [markdown]
# ## 4 The robot's unit in the 4 ms loop
#
# The same archive can be the plant behind a controller's C loop. The loop program is built with the functions of the
# model, and sends EGM datagrams to a simulated controller, whose plant is the unit. A servo of 40,000 N/m converts
# commanded positions into forces. The law `dynamics` knows the servo and the model, but not the payload of 1 kg.

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
print(f"{loop.plant}: rms error {off:.1f} mm with the reference alone, {on:.1f} mm with the model")
assert loop.status.ok and on < 0.5 * off

# %%
loop.figure("tracking")

# %% [markdown]
# ## Answer
#
# Yes. Three archives of 40 to 60 kB, run by a master that knows only variable names, do what the block diagram
# describes. Model and feedback together follow the filtered reference more closely than either alone, although the
# robot is 1 kg heavier than its model. And the archive of the robot can serve as the plant of the controller's own C
# program.
