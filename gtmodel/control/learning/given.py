"""Numbers of Dressler 2012, chapters 6 and 7, and those of our designs."""

from __future__ import annotations

# (6.11): b and a of the three controlled actuators of the L1 prototype, b q^-5 / (1 - a q^-1) at 4 ms
ACTUATORS = ((0.03527, 0.9647), (0.03425, 0.9656), (0.02748, 0.9728))
ACTUATOR_DELAY = 5
SAMPLE_TIME = 0.004
# samples between lead-in and lead-out by which a run is judged: the root mean square of fewer is known to no better
# than 10 %, one part in sqrt(2 n), half of the 20 % within which an error is said to be at its floor
JUDGED = 50
RAMP = 100  # samples of lead-in and of lead-out, section 7.3
CONTRACTION = 0.93  # the bound that is asked for over the whole set
LENGTH = 125  # lags of Q on either side: half a second at 4 ms
