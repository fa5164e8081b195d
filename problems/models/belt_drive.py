import gtmodel as gt


class BeltDrive(gt.Model):
    """Motor and load of a belt drive, both angles at the motor shaft."""

    motor_inertia, load_inertia = gt.parameter(0.002, unit="kg.m2"), gt.parameter(0.01, unit="kg.m2")
    stiffness, damping = gt.parameter(40.0, unit="N.m/rad"), gt.parameter(0.02, unit="N.m.s/rad")
    motor, load = gt.variable(unit="rad"), gt.variable(unit="rad")
    motor_rate, load_rate = gt.variable(unit="rad/s"), gt.variable(unit="rad/s")
    torque, push = gt.input(unit="N.m"), gt.input(unit="N.m")  # of the motor; unknown, on the load

    def equations(self):
        belt = self.stiffness * (self.motor - self.load) + self.damping * (self.motor_rate - self.load_rate)
        yield gt.der(self.motor) == self.motor_rate
        yield gt.der(self.load) == self.load_rate
        yield self.motor_inertia * gt.der(self.motor_rate) == self.torque - belt
        yield self.load_inertia * gt.der(self.load_rate) == belt + self.push
