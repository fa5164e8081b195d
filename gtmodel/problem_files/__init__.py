"""Problems in TOML files: loading, keys, sentences, settings, running, schema, listing."""

from .base import (
    Check as Check,
    Context as Context,
    FileSection as FileSection,
    InputError as InputError,
    Kind as Kind,
    Problem as Problem,
)
from .registry import get as get, names as names
