"""Problems in TOML files: loading, keys, error messages, settings, running, schema, listing."""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import python_models as python_models, robots as robots
    from .base import (
        Check as Check,
        Context as Context,
        FileSection as FileSection,
        InputError as InputError,
        Kind as Kind,
        Problem as Problem,
    )
    from .registry import get as get, names as names

public(__name__)
