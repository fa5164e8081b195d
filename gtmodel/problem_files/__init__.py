"""Problems in TOML files: loading, keys, sentences, settings, running, schema, listing."""

from .base import Check, Context, InputError, Kind, Problem, Section
from .registry import get, names

__all__ = ["Check", "Context", "InputError", "Kind", "Problem", "Section", "get", "names"]
