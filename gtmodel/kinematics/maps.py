"""Velocity and acceleration maps between two sets of coordinates of a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gtmodel.compiler.causal import CausalFunction, compile_causal
from gtmodel.lang import Model, ModelError

Array = np.ndarray


class MotionMaps:
    """Velocity and acceleration maps of a position causality: y' = J x' and y'' = J x'' + b.

    y is `target` as a function of x, `known`; J is its Jacobian, and b(x, x') is quadratic in x'.

    Forward maps of a robot are MotionMaps(robot, "q", "T"), inverse ones MotionMaps(robot, "T", "q") (Dressler 2012,
    eqs. (6.5), (6.6)). J comes from implicit differentiation, b from the twice differentiated equations.

    branches: as for `causal`. Raises ModelError where y does not follow from x alone.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> J, status = gt.kinematics.MotionMaps(robot, "T", "q").velocity([0.0, -0.9, 0.1])  # carts per tool centre point
    >>> J.round(2)
    array([[ 1.  , -0.71, -1.06],
           [ 1.  ,  0.36, -1.2 ],
           [ 1.  , -0.57,  0.06]])
    """

    def __init__(self, model: Model, known: str, target: str, branches: Mapping[str, int] | None = None) -> None:
        self.position: CausalFunction = compile_causal(model, known, target, branches=branches)
        names = [s.name for s in self.position.inputs]
        if names != [known]:
            raise ModelError(f"'{target}' does not follow from '{known}' alone; it needs {', '.join(names)}")
        self._known = known
        self._second = compile_causal(model, known, f"der({target},2)", branches=branches)

    def velocity(self, x: Any) -> tuple[Array, Any]:
        """J (m, n) or (rows, m, n), and the status."""
        return self.position.jacobian(x)

    def acceleration(self, x: Any, rate: Any) -> tuple[Array, Array, Any]:
        """J, b (m,) or (rows, m), and the status; `rate` is x'."""
        given = {self._known: x, f"der({self._known})": rate, f"der({self._known},2)": np.zeros_like(np.asarray(rate))}
        bias, status = self._second(*[given[s.name] for s in self._second.inputs])
        J, _ = self.velocity(x)
        return J, bias, status
