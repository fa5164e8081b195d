"""Spectral radius of the closed loop of the L1 near its goal under servos of the axes that the controller knows, by
their natural frequency and the cycles of delay, over EGM and RSI.

Run: python -m tests.bench.bench_servo
"""

from __future__ import annotations

from tests.predictive.test_servo import law_of, of_rate

RATES = (5.0, 20.0, 50.0, 100.0, 200.0, 300.0, 500.0)  # rad/s
DAMPING = 0.5


def main() -> None:
    """Print the table."""
    print("delay peer " + "".join(f"{rate:7g}" for rate in RATES) + "  rad/s")
    for delay in range(4):
        laws = [law_of(of_rate(rate, DAMPING), delay) for rate in RATES]
        for peer in ("EGM", "RSI"):
            print(f"{delay:5} {peer:4} " + "".join(f"{law.radius(speeds=peer == 'EGM'):7.3f}" for law in laws))


if __name__ == "__main__":
    main()
