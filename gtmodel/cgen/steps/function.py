"""What a step function is, whatever it computes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...results.status import Status
from ..real import Real
from .records import StepMember, record


class StepTwin(ABC):
    """A step function in Python, operation by operation as in C: its records hold the same bytes."""

    @abstractmethod
    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """A new state from a record of the start; written with OK only."""

    @abstractmethod
    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """One cycle; state and outputs are written with OK only."""


class StepFunction(ABC):
    """What is computed once in a cycle from inputs and from what it remembers: a filter, a sampled block.

    Base class. A subclass says what its structs hold and how C and Python compute; the folder, the header, the
    self-test and the comparison with Python are made from that, see docs/c_contract.md.

    title: one line. period: of a cycle [s]. start, inputs, outputs, state: members of its structs.
    defaults: values of the start by name. runtime: hand-written headers that it needs, the one that
    includes the others first.
    """

    title: str
    period: float
    start: Sequence[StepMember]
    inputs: Sequence[StepMember]
    outputs: Sequence[StepMember]
    state: Sequence[StepMember]
    defaults: Mapping[str, Any]
    runtime: Sequence[str] = ()

    @abstractmethod
    def kernels(self, symbol: str) -> list[ca.Function]:
        """The generated bodies under their C names."""

    @abstractmethod
    def text(self, symbol: str, real: Real) -> str:
        """C of `symbol`_init and `symbol`_step, with its tables; in double."""

    @abstractmethod
    def twin(self, real: Real) -> StepTwin:
        """The same in Python."""

    @abstractmethod
    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Records of inputs, one after the other, as a run meets them."""

    @abstractmethod
    def complete(self, real: Real) -> np.ndarray:
        """A record of inputs with which the declared start goes on well, nothing missing: where it costs most."""

    @abstractmethod
    def facts(self) -> Mapping[str, Any]:
        """What it was made from, for manifest and hash: numbers exact to the last bit."""

    def explain(self) -> str:
        """What it computes, in words."""
        return "\n".join([self.title, *self.notes()])

    def notes(self) -> Sequence[str]:
        """What its statuses mean, for the header."""
        return ()


@dataclass(frozen=True)
class StepFace:
    """A step function under the C name `symbol`."""

    key: str
    symbol: str
    function: StepFunction
    real: Real

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of all names that it defines for others."""
        return ("start", "in", "out", "state", "defaults", "init", "step")

    def started(self) -> tuple[np.ndarray, np.ndarray]:
        """The records of the declared start and of an empty state."""
        f = self.function
        return record(f.start, self.real, f.defaults), record(f.state, self.real)
