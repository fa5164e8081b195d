"""Models, functions and generated folders that the tests of C code share."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel.compiler.causal import CausalFunction
from gtmodel.compiler.toolchain import Toolchain
from tests.bench.callgrind import missing

Functions = dict[str, CausalFunction]


class Pendulum(gt.Model):
    """A point mass on a rod in a plane; the upper half where x[0] > 0, singular at the bottom."""

    length = gt.parameter(1.0, unit="m", positive=True)
    m = gt.parameter(2.0, unit="kg", positive=True)
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(2, unit="m", start=[0.8, -0.6], description="mass, right and up")
    tension = gt.variable(unit="N/m", description="rod force per length, pull positive")

    def equations(self):
        yield gt.dot(self.x, self.x) == self.length**2
        yield self.m * gt.der(self.x[0], 2) == -self.tension * self.x[0]
        yield self.m * gt.der(self.x[1], 2) == -self.tension * self.x[1] - self.m * self.g
        yield gt.branch("right", self.x[0])


class SliderCrank(gt.Model):
    """A crank with angle phi drives a slider at x through a connecting rod."""

    r = gt.parameter(0.1, unit="m", positive=True, description="crank radius")
    rod = gt.parameter(0.3, unit="m", positive=True, description="length of the connecting rod")
    omega = gt.parameter(7.0, unit="rad/s")
    phi = gt.variable(unit="rad", start=0.6, description="crank angle from the slider's line")
    x = gt.variable(unit="m", start=0.35, description="slider, away from the crank")
    p = gt.variable(2, unit="m")
    wobble = gt.variable(unit="m", description="slider and a disturbance that depends on time")

    def equations(self):
        yield self.p == self.r * gt.vector([gt.cos(self.phi), gt.sin(self.phi)])
        yield (self.x - self.p[0]) ** 2 + self.p[1] ** 2 == self.rod**2
        yield self.wobble == self.x + self.r * gt.sin(self.omega * self.time)
        yield gt.branch("ahead", self.x - self.p[0])


@pytest.fixture(scope="session", autouse=True)
def compiled_once() -> Iterator[None]:
    """What `check` compiles: the same source beside the same headers gives the same object, so it is made once."""
    made: dict[object, tuple[bool, str, bytes]] = {}
    real = Toolchain.compile

    def compile_once(tools: Toolchain, source: Path, target: Path) -> tuple[bool, str]:
        others = sorted([*source.parent.glob("*.h"), *source.parent.glob("*_body.c")])  # guards may include bodies
        key = (tools.cc, source.name, source.read_bytes(), *[(p.name, p.read_bytes()) for p in others])
        if key not in made:
            good, text = real(tools, source, target)
            made[key] = good, text, target.read_bytes() if good else b""
        good, text, content = made[key]
        if good:
            target.write_bytes(content)
        return good, text

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Toolchain, "compile", compile_once)
        yield


@pytest.fixture(scope="session")
def l1() -> Functions:
    robot = gt.robots.gantry_tau("l1_tape")
    return {
        "fk": robot.causal(known="q", targets="T"),
        "ik": robot.causal(known="T", targets="q"),
        "velocity": robot.causal(known="T", targets=["q", "der(q)"]),
        "inverse_dynamics": robot.causal(known="T", targets="tau"),
        "forward_dynamics": robot.causal(known="tau", targets="der(T,2)"),
    }


@pytest.fixture(scope="session")
def small() -> Functions:
    """Two models of a user in one folder; one function depends on time, one can be singular."""
    crank = SliderCrank()
    return {
        "slider": crank.causal(known="phi", targets=["x", "der(x)"]),
        "wobble": crank.causal(known="phi", targets="wobble"),
        "pendulum": Pendulum().causal(targets=["tension", "der(x)"], prefer="x[1]"),
    }


@pytest.fixture(scope="session")
def f1() -> Functions:
    robot = gt.robots.f1_gantry_tau()
    return {
        "fk": robot.causal("q", ["T", "e"]),
        "ik": robot.causal(["T", "e"], "q"),
        "velocity": robot.causal(["T", "e"], ["q", "der(q)"]),
    }


@pytest.fixture(scope="session")
def newton_functions(f1: Functions) -> Functions:
    six = gt.robots.six_link_gantry_tau()
    return {"six_link_fk": six.causal("q", ["T", "e"]), "fk": f1["fk"], "ik": f1["ik"]}


@pytest.fixture(scope="session")
def l1_folder(l1: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The generated folder of the robot; tests must not change it."""
    return cgen.generate(l1, tmp_path_factory.mktemp("generated") / "l1", name="l1").folder


@pytest.fixture(scope="session")
def small_folder(small: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The generated folder of the small models; tests must not change it."""
    return cgen.generate(small, tmp_path_factory.mktemp("generated") / "small", name="small").folder


@pytest.fixture(scope="session")
def callgrind() -> None:
    """For what counts instructions: skips where that cannot be done, and says why."""
    reason = missing()
    if reason:
        pytest.skip(reason)


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A finished command with its output as text."""
    return subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, timeout=120)


def succeed(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed and warn of nothing."""
    done = run(*command, cwd=cwd)
    assert done.returncode == 0 and done.stderr == "", f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def copy(folder: Path, target: Path) -> Path:
    """A copy that a test may change or compile in."""
    return Path(shutil.copytree(folder, target / folder.name))


def c_files(folder: Path) -> list[str]:
    """What a shell makes of *.c."""
    return sorted(p.name for p in folder.glob("*.c"))
