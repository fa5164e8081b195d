"""Models as a user writes them, in a file of their own beside their problem file."""

PENDULUM = '''
import gtmodel as gt
from gtmodel import der


class Pendulum(gt.Model):
    """A driven pendulum, angle from hanging."""

    m = gt.parameter(1.0, unit="kg", positive=True)
    L = gt.parameter(0.5, unit="m", positive=True)
    g = gt.parameter(9.81, unit="m/s2")
    phi = gt.variable(unit="rad")
    tau = gt.input(unit="N.m")

    def equations(self):
        yield self.m * self.L**2 * der(der(self.phi)) + self.m * self.g * self.L * gt.sin(self.phi) == self.tau


class SwingUp(gt.Optimization):
    """Fastest swing from rest to rest without gravity, so that the answer is 2 sqrt(angle m L^2 / torque)."""

    angle = gt.parameter(1.0, unit="rad")
    final_time = gt.free(guess=1.0, min=0.1, unit="s")
    pendulum = gt.part(Pendulum, g=0.0, tau=dict(min=-1.0, max=1.0))

    def objective(self):
        return self.final_time

    def constraints(self):
        phi = self.pendulum.phi
        yield phi.at(self.start_time) == 0
        yield der(phi).at(self.start_time) == 0
        yield phi.at(self.final_time) == self.angle
        yield der(phi).at(self.final_time) == 0
'''

SLIDER_CRANK = '''
import gtmodel as gt
from gtmodel import der


class SliderCrank(gt.Model):
    """Crank of radius r, rod of length l, slider on the x axis, ahead of the crank pin."""

    r = gt.parameter(0.1, unit="m", positive=True)
    l = gt.parameter(0.3, unit="m", positive=True)
    J = gt.parameter(0.01, unit="kg.m2", positive=True)
    phi = gt.variable(unit="rad", start=1.0)
    x = gt.variable(unit="m", start=0.3)
    pin = gt.variable(2, unit="m")
    tau = gt.input(unit="N.m")

    def equations(self):
        yield self.pin[0] == self.r * gt.cos(self.phi)
        yield self.pin[1] == self.r * gt.sin(self.phi)
        yield (self.x - self.pin[0]) ** 2 + self.pin[1] ** 2 == self.l**2
        yield self.J * der(der(self.phi)) == self.tau
        yield gt.branch("ahead", self.x - self.pin[0])


class Stroke(gt.Optimization):
    """Fastest quarter turn of the crank from rest to rest: 2 sqrt(pi/2 J / torque)."""

    final_time = gt.free(guess=0.5, min=0.05, unit="s")
    crank = gt.part(SliderCrank)

    def objective(self):
        return self.final_time

    def constraints(self):
        phi = self.crank.phi
        yield gt.between(self.unit * -1.0, self.crank.tau, self.unit * 1.0)
        yield phi.at(self.start_time) == 0.5
        yield der(phi).at(self.start_time) == 0
        yield phi.at(self.final_time) == 0.5 + 1.5707963267948966
        yield der(phi).at(self.final_time) == 0

    unit = gt.parameter(1.0, unit="N.m")
'''

SWING_UP_TOML = """
kind = "optimization"
title = "Swing of a pendulum"
model = "pendulum.py:SwingUp"
[mesh]
elements = 16
"""

STROKE_TOML = """
kind = "optimization"
model = "slider_crank.py:Stroke"
[mesh]
elements = 16
"""

PENDULUM_CODE_TOML = """
kind = "codegen"
name = "pendulum"
robot = "pendulum.py:Pendulum"
[[functions]]
name = "inverse_dynamics"
known = ["phi"]
targets = ["tau"]
"""

SLIDER_CRANK_CODE_TOML = """
kind = "codegen"
robot = "slider_crank.py:SliderCrank"
[[functions]]
name = "slider"
known = ["phi"]
targets = ["x", "der(x)"]
"""

FILES = {
    "pendulum.py": PENDULUM,
    "slider_crank.py": SLIDER_CRANK,
    "swing.toml": SWING_UP_TOML,
    "stroke.toml": STROKE_TOML,
    "pendulum_code.toml": PENDULUM_CODE_TOML,
    "slider_code.toml": SLIDER_CRANK_CODE_TOML,
}
