import gtmodel as gt


class Pendulum(gt.Model):
    length, gravity = gt.parameter(0.8, unit="m"), gt.parameter(9.81, unit="m/s2")
    damping = gt.parameter(0.15, unit="1/s")
    angle, rate, push = gt.variable(unit="rad"), gt.variable(unit="rad/s"), gt.input(unit="rad/s2")

    def equations(self):
        weight = self.gravity / self.length * gt.sin(self.angle)
        yield gt.der(self.angle) == self.rate
        yield gt.der(self.rate) == self.push - self.damping * self.rate - weight
