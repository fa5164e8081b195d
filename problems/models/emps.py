"""The EMPS drive: one prismatic axis with friction and a position loop around a velocity loop.

Janot, Gautier, Brunot: Data set and reference models of EMPS, Nonlinear System Identification Benchmarks, 2019.
"""

import gtmodel as gt
from gtmodel import der


class Emps(gt.Model):
    """Carriage q [m] driven by tau [N]: tau = M q'' + F_v q' + F_c sign(q') + offset. For identification.

    The parameter values were published with the data; they come from least squares on the inverse model.
    """

    M = gt.parameter(95.1089, unit="kg", positive=True, description="moved mass, including the motor inertia")
    F_v = gt.parameter(203.5034, unit="kg/s", description="viscous friction")
    F_c = gt.parameter(20.3935, unit="N", description="Coulomb friction")
    offset = gt.parameter(-3.1648, unit="N", description="force offset at standstill, and asymmetry of the friction")
    q = gt.variable(unit="m", description="position of the carriage")
    tau = gt.input(unit="N", nominal=100.0, description="force of the drive")

    def equations(self):
        rate = der(self.q)
        yield self.tau == self.M * der(rate) + self.F_v * rate + self.F_c * self.direction(rate) + self.offset

    def direction(self, rate):
        """Sign of the velocity."""
        return gt.sign(rate)


class ControlledEmps(Emps):
    """The drive with its control loops and reference qg [m]: tau = gain kv (kp (qg - q) - q'). For simulation.

    The sign is smoothed by tanh(q' / velocity_scale), which a simulation needs.
    """

    gain = gt.parameter(35.15065188248547, unit="N/V", description="force per drive voltage")
    kp = gt.parameter(160.18, unit="1/s", description="gain of the position loop")
    kv = gt.parameter(243.45, unit="V.s/m", description="gain of the velocity loop")
    velocity_scale = gt.parameter(1e-3, unit="m/s", positive=True, description="velocity of the smoothed sign")
    qg = gt.input(unit="m", description="reference position")
    tau = gt.variable(unit="N", nominal=100.0, description="force of the drive")

    def equations(self):
        yield from super().equations()
        yield self.tau == self.gain * self.kv * (self.kp * (self.qg - self.q) - der(self.q))

    def direction(self, rate):
        return gt.tanh(rate / self.velocity_scale)
