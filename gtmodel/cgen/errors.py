"""The one exception of this package."""


class GenerationError(ValueError):
    """Code that cannot be generated, written or compared; the message is one plain sentence."""
