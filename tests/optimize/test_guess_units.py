"""A guess in another unit is another quantity: it is refused, whatever it is a guess of."""

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.lang import ModelError
from gtmodel.optimize import Mesh, solve
from gtmodel.results import Trajectory

VALUES = {"x": [0.0, 1.0], "der(x)": [1.0, 1.0], "F": [0.0, 0.0]}
UNITS = {"x": "m", "der(x)": "m/s", "F": "N"}


class Cart(gt.Optimization):
    """From rest over 1 m within 2 s."""

    m = gt.parameter(1.0, unit="kg")
    x = gt.variable(start=0.0, fixed=True, unit="m")
    F = gt.input(unit="N")
    final_time = 2.0

    def equations(self):
        yield self.m * der(der(self.x)) == self.F

    def constraints(self):
        yield der(self.x).at(0.0) == 0
        yield self.x.at(self.final_time) == 1

    def objective(self):
        return gt.integral(self.F**2)


def _solved(units: dict[str, str]) -> bool:
    return solve(Cart(), Mesh(3), guess=Trajectory([0.0, 2.0], VALUES, units)).status.ok


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("unit", ["kg", "rad", "m/s2"])
def test_another_unit_is_refused_by_its_signal(name: str, unit: str) -> None:
    with pytest.raises(ModelError) as caught:
        _solved({**UNITS, name: unit})
    assert name in str(caught.value) and unit in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", UNITS)
def test_the_same_unit_written_otherwise_and_none_at_all_are_taken(name: str) -> None:
    assert _solved(UNITS) and _solved({n: u for n, u in UNITS.items() if n != name})
    assert _solved({**UNITS, "F": "kg.m/s2"})
