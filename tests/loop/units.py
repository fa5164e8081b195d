"""Units of synthetic plants for the loop, each compiled once, and archives with one thing changed."""

from __future__ import annotations

import io
import zipfile
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.loop.plant import PlantStopped
from gtmodel.results import Status
from gtmodel.robots import actuator_closed_loop

TCP = [0.0, -0.9, 0.1]  # where `smooth` begins
CARTS, MOTORS = [[f"{name}[{k}]" for k in (1, 2, 3)] for name in ("q", "tau")]
SPEEDS = [f"der({q})" for q in CARTS]
COMMANDS, POSITIONS = [[f"{name}[{k}]" for k in (1, 2, 3)] for name in ("command", "position")]
DRIVES = actuator_closed_loop()
WAITING = DRIVES["delay"] - 1  # cycles before a command is the one that acts


@cache
def robot():
    return gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1)


@cache
def start():
    """Carts where the reference begins, as the loop computes them."""
    inverse = robot().causal(known="T", targets=["q", "der(q)", "der(q,2)"])
    rows = np.array([TCP, TCP])
    return inverse(rows, 0 * rows, 0 * rows)[0][0].tolist()


def drives_block():
    """`DrivePlant` as a sampled block: a command acts as late, and every product and sum has its place."""

    class DrivesOf611(gt.SampledBlock):
        a = gt.parameter(DRIVES["a"])
        b = gt.parameter(DRIVES["b"])
        origin = gt.parameter(start(), unit="m")
        command = gt.input(3, unit="m")
        waiting = gt.discrete([0.0] * 3 * WAITING, unit="m")
        at = gt.discrete(start(), unit="m")
        position = gt.output(start(), unit="m")

        def step(self, inputs, state):
            moved = self.a * (state.at - self.origin) + self.b * state.waiting[:3]
            waiting = np.concatenate([state.waiting[3:], inputs.command - self.origin])
            return {"waiting": waiting, "at": self.origin + moved, "position": self.origin + moved}

    class DrivesDesk(gt.Model):
        command = gt.input(3, unit="m")
        drives = gt.part(DrivesOf611, period=0.004)

        def equations(self):
            yield self.drives.command == self.command

    return gt.cgen.BlockFunction(DrivesDesk(), "drives")


@cache
def drives(version: int) -> gt.fmu.Fmu:
    return gt.fmu.export(drives_block(), None, version=version, name="drives")


@cache
def rigid(version: int = 3) -> gt.fmu.Fmu:
    f = robot().causal(known="tau", targets=["q", "der(q)"], prefer="T")
    return gt.fmu.export(f, None, version=version, name="rigid", start={"T": TCP}, stop=0.1)


def drives_plant(unit: object, **more: object) -> gt.fmu.PlantUnit:
    return gt.fmu.PlantUnit(unit, POSITIONS, command=COMMANDS, **more)  # type: ignore[arg-type]


def rigid_plant(unit: object, **more: object) -> gt.fmu.PlantUnit:
    return gt.fmu.PlantUnit(unit, CARTS, force=MOTORS, speed=SPEEDS, **more)  # type: ignore[arg-type]


class HeldServo:
    """The robot as rigid bodies, its forces held for a substep of the servo: equations by CasADi, Runge and Kutta here.

    parts: of a substep, as the unit's inner step has it.
    """

    def __init__(self, servo: gt.loop.Servo, parts: int, cycle_s: float) -> None:
        self.servo, self.cycle_s, self.time = servo, cycle_s, 0.0
        self._step, self._function = _substep(cycle_s / servo.substeps, parts)
        self._x = np.array([*TCP, 0.0, 0.0, 0.0])
        self.position_m = self.carts()[0]

    @property
    def arm_m(self):
        return self.position_m

    def carts(self):
        q, dq, status = self._function(self._x[:3], self._x[3:])
        if status is not Status.OK or not np.all(np.isfinite(self._x)):
            raise PlantStopped(f"no answer at {self.time:g} s", self.time)
        return q, dq

    def step(self, position_m, speed_m_s):
        u, du = np.array(position_m), np.array(speed_m_s)
        h = self.cycle_s / self.servo.substeps
        for k in range(self.servo.substeps):
            q, dq = self.carts()
            force = self.servo.kp_N_m * (u + k * h * du - q) + self.servo.kd_N_s_m * (du - dq)
            self._x = np.array(self._step(self._x, force)).ravel()
            self.carts()
            self.time += h
        self.position_m = self.carts()[0]


@cache
def _substep(length: float, parts: int):
    """(state, forces) -> state after a substep; T, der(T) -> carts and their speeds."""
    x, tau = ca.SX.sym("x", 6), ca.SX.sym("tau", 3)
    forward = robot().causal(known="tau", targets="der(T,2)", prefer="T")

    def rate(state):
        names = {"T": state[:3], "der(T)": state[3:], "tau": tau}
        acceleration, *_ = forward.casadi.call([names[s.name] for s in forward.inputs])
        return ca.vertcat(state[3:], acceleration)

    h, state = length / parts, x
    for _ in range(parts):
        k1 = rate(state)
        k2 = rate(state + h / 2 * k1)
        k3 = rate(state + h / 2 * k2)
        k4 = rate(state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [x, tau], [state]), robot().causal(known="T", targets=["q", "der(q)"])


def changed(unit: gt.fmu.Fmu, place: Path, *pairs: tuple[str, str], without: str = "nothing of it") -> Path:
    """The archive with other words in its description, each of which must be there, and without some of its files."""
    path = place / "changed.fmu"
    with zipfile.ZipFile(io.BytesIO(unit.data)) as archive, zipfile.ZipFile(path, "w") as written:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "modelDescription.xml":
                for old, new in pairs:
                    assert old.encode() in content, old
                    content = content.replace(old.encode(), new.encode())
            if without not in name:
                written.writestr(name, content)
    return path
