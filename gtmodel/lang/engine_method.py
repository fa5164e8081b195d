"""Methods of a model that an engine provides: the language names them and imports no engine."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any


class EngineMethod:
    """A method that is a function of another module, which is imported when the method is first asked for."""

    def __init__(self, module: str, function: str) -> None:
        self._module, self._function = module, function

    def __get__(self, model: Any, owner: type) -> Callable[..., Any]:
        function = getattr(import_module(self._module), self._function)
        return function if model is None else function.__get__(model, owner)
