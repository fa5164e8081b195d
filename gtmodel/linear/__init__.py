"""Linear systems as matrices, and roots in one variable, for plain numbers.

state_space   held, ramped, held_late: to discrete time; second_order: M x'' + D x' + K x = F u;
              continuous_poles, frequency_and_damping; settled_covariance: of a Kalman filter, by the Riccati equation
response      simulate, states, free_responses, late_lag; Transfer: C (z - A)^-1 B at any z
roots         crossing: zero of a continuous function, by Brent's method; bisected: threshold of a condition
"""
