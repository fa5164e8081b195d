"""What a vibration study is asked for: which model, what is known beside the recording, synthetic data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ..results.options import Options, Unit, Within
from .impulse import LARGEST as MOST_MODES
from .step_response import LONGEST
from .subspace import BLOCK_ROWS, HELD_OUT, LARGEST


@dataclass(frozen=True)
class Subspace(Options):
    """How the state-space model is found."""

    method: Annotated[Literal["moesp", "n4sid", "cva"], "how past and future are weighted"] = "moesp"
    order: Annotated[int | None, Within(least=1), "number of states; by held-out error if left out"] = None
    largest_order: Annotated[int, Within(least=1), "tried at most"] = LARGEST
    block_rows: Annotated[int, Within(least=2), "of past and future each"] = BLOCK_ROWS
    held_out: Annotated[float, Within(above=0.0, below=1.0), "share of the samples judged, not fitted"] = HELD_OUT
    feedthrough: Annotated[bool, "whether the input acts on the output at once"] = False


@dataclass(frozen=True)
class KnownMass(Options):
    """A mass that is known."""

    coordinate: Annotated[int, Within(least=1), "from 1"]
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "its mass"]


@dataclass(frozen=True)
class Physical(Options):
    """The physical form: what is known beside the recording."""

    force_coordinates: Annotated[
        list[int], "coordinate on which each input acts in newtons, from 1; with force_N only"
    ] = field(default_factory=list)
    mass: Annotated[list[KnownMass], "one table for each known mass"] = field(default_factory=list)
    form: Annotated[
        Literal["symmetric", "free"], "symmetric: M, D, K positive definite by Cholesky factors; free: any D"
    ] = "symmetric"
    refine: Annotated[
        bool, "fit M, D, K to the recording by output error, with intervals; needs a force"
    ] = True  # fmt: skip


@dataclass(frozen=True)
class StepResponse(Options):
    """How the step response is fitted."""

    delay_samples: Annotated[int | None, Within(least=0), "by least residual if left out"] = None
    longest_samples: Annotated[int, Within(least=0), "delay tried at most"] = LONGEST


@dataclass(frozen=True)
class Impulse(Options):
    """How the decay is fitted."""

    modes: Annotated[
        int | None, Within(least=1), "number of resonances; by information criterion if left out"
    ] = None  # fmt: skip
    largest: Annotated[int, Within(least=1), "number tried at most"] = MOST_MODES


@dataclass(frozen=True)
class Matrices(Options):
    """Printed matrices of M x'' + D x' + K x = f."""

    M: Annotated[list[list[float]], Unit("kg"), "masses, row by row"]
    D: Annotated[list[list[float]], Unit("kg/s"), "damping"]
    K: Annotated[list[list[float]], Unit("N/m"), "stiffness"]
    published: Annotated[list[float], Unit("Hz"), Within(above=0.0), "modes printed beside them, to be reproduced"] = (
        field(default_factory=list)
    )
    published_digits: Annotated[float, Unit("Hz"), Within(above=0.0), "half a unit of their last digit"] = 0.5


@dataclass(frozen=True)
class Sampling(Options):
    """A synthetic recording of a known system, to see what identification gives back."""

    seed: Annotated[int, Within(least=0), "of the noise, and of the pseudo-random force"]
    noise: Annotated[float, Unit("m"), Within(least=0.0), "white noise on the positions, standard deviation"]
    samples: Annotated[int, Within(least=2), "of each recording"]
    sample_time: Annotated[float, Unit("s"), Within(above=0.0), "between samples"] = 0.004


@dataclass(frozen=True)
class Structure(Options):
    """Masses, dampers and springs under a pseudo-random force."""

    M: Annotated[list[list[float]], Unit("kg"), "masses, row by row"]
    D: Annotated[list[list[float]], Unit("kg/s"), "damping"]
    K: Annotated[list[list[float]], Unit("N/m"), "stiffness"]
    force: Annotated[float, Unit("N"), Within(above=0.0), "amplitude of the pseudo-random binary force"]
    coordinate: Annotated[int, Within(least=1), "on which it acts, from 1"] = 1
    hold_samples: Annotated[int, Within(least=1), "how long a value is held: longer moves its power down"] = 1


@dataclass(frozen=True)
class Steps(Options):
    """Steps of the reference through b q^-delay / (1 - a q^-1), each a recording of its own."""

    a: Annotated[float, Within(above=-1.0, below=1.0), "pole"]
    b: Annotated[float, "numerator"]
    delay_samples: Annotated[int, Within(least=0), "delay"]
    amplitudes: Annotated[list[float], Unit("m"), "one step each"]
    rest_samples: Annotated[int, Within(least=1), "before the step"] = 25


@dataclass(frozen=True)
class Hit(Options):
    """Free decay after the hit of a hammer."""

    frequency: Annotated[list[float], Unit("Hz"), Within(above=0.0), "undamped, by mode"]
    damping: Annotated[list[float], Within(least=0.0), "ratio, by mode"]
    amplitude: Annotated[list[list[float]], Unit("m"), "by mode and measured position"]
