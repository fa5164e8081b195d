"""How many examples hypothesis draws."""

from __future__ import annotations

import os

from hypothesis import settings

# Set where the tests run a second time, in a copy of the package: what is asked there is whether they run at all.
AGAIN = "GTMODEL_WITHOUT_ROBOTS"


def examples(count: int) -> settings:
    """Settings for `count` examples, without a time limit: the first one compiles the model."""
    return settings(max_examples=5 if AGAIN in os.environ else count, deadline=None)
