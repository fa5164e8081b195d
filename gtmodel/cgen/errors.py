"""The one exception of this package."""

from ..results.refusal import ArgumentError


class GenerationError(ArgumentError):
    """Code that cannot be generated, written or compared; the message is one plain sentence."""
