"""Reference motions for synthetic experiments: fast and slow sines together, from rest to rest."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def multisine(
    time: Array,
    centre: Array,
    half_range: Array,
    frequencies: Array,
    seed: int,
    ramp: float = 1.0,
) -> Array:
    """Sums of sines about `centre` (k,), (n, k), which begin and end at rest there.

    Dressler 2012, section 6.2, combines fast and slow motion in one experiment: here all `frequencies` [Hz] have the
    same velocity amplitude, random phases by `seed`, and the sum stays within `half_range` (k,) of the centre. Over the
    first and last `ramp` seconds it grows and fades with three continuous derivatives.

    Raises ValueError for a ramp that is longer than half of the time.
    """
    time, f = np.asarray(time, dtype=float), np.asarray(frequencies, dtype=float)
    length = float(time[-1] - time[0])
    if not 0 < 2 * ramp <= length:
        raise ValueError(f"a motion of {length:g} s cannot grow and fade over {ramp:g} s each; take a shorter ramp")
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, (len(f), len(centre)))
    # slightly other frequencies on each axis, so that no two axes repeat each other's pattern
    own = f[:, None] * (1 + 0.15 * (np.arange(len(centre)) - (len(centre) - 1) / 2))
    sines = np.sum(np.sin(2 * np.pi * own * time[:, None, None] + phases) / own, axis=1)
    fade = _rise((time - time[0]) / ramp) * _rise((time[-1] - time) / ramp)
    shape = fade[:, None] * sines
    return np.asarray(centre, dtype=float) + np.asarray(half_range, dtype=float) * shape / np.max(np.abs(shape), axis=0)


def _rise(x: Array) -> Array:
    """From 0 to 1 over [0, 1] with three continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3)
