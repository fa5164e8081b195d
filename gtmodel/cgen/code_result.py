"""Result of the study of generated code, and options of its comparison with Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from ..results.options import Options, Within

COSTS = "costs.json"
Counts = Mapping[str, int]


@dataclass(frozen=True)
class Verification(Options):
    """Options of the comparison: compiled C and Python compute the same random inputs.

    >>> gt.cgen.Verification(points=200, seed=3)
    Verification(points=200, seed=3)
    >>> gt.cgen.Verification(points=0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: points: ...
    """

    points: Annotated[int, Within(above=0), "random inputs per function"] = 1000
    seed: Annotated[int, Within(least=0), "of the random inputs"] = 0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CodeStudy(Study):
    """Generated files, and their costs if they were asked for.

    real: number type in C, "double" or "float". notes: costs that could not be counted, with the reason.
    """

    real: str = "double"
    folder: Annotated[str | None, Quantity("", "where the code was written")] = None
    functions: Annotated[
        Mapping[str, Mapping[str, Sequence[str]]] | None,
        Quantity("", "C name of each function -> its inputs and outputs"),
    ] = None
    written: Annotated[Sequence[str] | None, Quantity("", "files written, sorted", key="files")] = None
    operations: Annotated[
        Counts | None, Quantity("", "operations and calls of libm in one evaluation of each body")
    ] = None  # fmt: skip
    points: Annotated[int | None, Quantity("", "with --check: number of random inputs compared per function")] = None
    text_bytes: Annotated[Counts | None, Quantity("", "with --costs: machine code of each function at -O2")] = None
    newton_bytes: Annotated[
        Counts | None, Quantity("", "with --costs: of it the Newton blocks and their guards")
    ] = None  # fmt: skip
    stack_bytes: Annotated[Counts | None, Quantity("", "with --costs: stack of a call")] = None
    instructions: Annotated[
        Counts | None, Quantity("", "with --costs: instructions of a call with its guards, counted by callgrind")
    ] = None  # fmt: skip
    symbols: Annotated[Sequence[str] | None, Quantity("", "with --costs: what the folder defines for others")] = None

    @property
    def values(self) -> Mapping[str, Any]:
        """The quantities that are not None."""
        return {name: value for name, value in super().values.items() if value is not None}

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.functions is None:
            return []
        return [
            Row("folder", self.folder),
            Row("files", sum(file != COSTS for file in self.written or ())),
            Row("numbers", self.real),
            *(Row(name, _in_words(signature)) for name, signature in self.functions.items()),
            *(Row(f"{name} costs", self._cost(name)) for name in self.text_bytes or ()),
        ]

    def _cost(self, name: str) -> str:
        text, stack, instructions = (
            (costs or {}).get(name) for costs in (self.text_bytes, self.stack_bytes, self.instructions)
        )
        counted = "" if instructions is None else f", {instructions} instructions"
        return f"{text} bytes of code, {stack} of stack{counted}"


def _in_words(signature: Mapping[str, Sequence[str]]) -> str:
    return f"{', '.join(signature['outputs'])} from {', '.join(signature['inputs']) or 'nothing'}"
