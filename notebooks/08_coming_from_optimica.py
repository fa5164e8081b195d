# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Coming from Optimica
#
# **I have Modelica models with an Optimica `optimization` class. What do I write here, and is it the same problem?**
#
# Modelica describes the model, Optimica the optimisation problem on top of it. Here both are Python classes. This
# notebook puts the two languages side by side: a bound and an integral, a free final time, a path constraint, constants
# from measurements. Every answer is compared with a number from an independent source.
#
# | Optimica | gtmodel |
# |---|---|
# | `model M ... end M;` | `class M(gt.Model)` |
# | `optimization P(...) extends M;` | `class P(M, gt.Optimization)` |
# | `M m;` as a component | `m = gt.part(M)` |
# | `Real x(start=1, fixed=true, nominal=2)` | `x = gt.variable(start=1.0, fixed=True, nominal=2.0)` |
# | `input Real u(max=0.75)` | `u = gt.input(max=0.75)` |
# | `parameter Real k = 2` | `k = gt.parameter(2.0)` |
# | `parameter Real k(free=true, initialGuess=2, min=0)` | `k = gt.free(2.0, min=0.0)` |
# | `startTime=0, finalTime=20` | `final_time = 20.0` (and `start_time`, 0 by default) |
# | `finalTime(free=true, initialGuess=2, min=0.2)` | `final_time = gt.free(guess=2.0, min=0.2)` |
# | `objective = cost(finalTime)` | `def objective(self): return self.cost.at(self.final_time)` |
# | `objectiveIntegrand = x^2 + u^2` | `return gt.integral(self.x**2 + self.u**2)` |
# | `constraint x(finalTime) = 0;` | `yield self.x.at(self.final_time) == 0` in `constraints` |
# | `constraint u <= 1 + x;` | `yield self.u <= 1 + self.x` |
# | `time`, `der(x)` | `self.time`, `der(self.x)` |
# | `n_e=50, n_cp=3` | `gt.Mesh(50, points=3)` |
# | `init_traj`, `nominal_traj` | `guess=`, and `nominal` of the variables |

# %%
# %matplotlib inline
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import gtmodel as gt
from gtmodel import der

# %% [markdown]
# ## 1 A model, and an optimisation of it
#
# Van der Pol's oscillator with an input, in Modelica and Optimica:
#
# ```modelica
# model Oscillator
#   Real x1(start=0, fixed=true);
#   Real x2(start=1, fixed=true);
#   input Real u;
# equation
#   der(x1) = (1 - x2^2)*x1 - x2 + u;
#   der(x2) = x1;
# end Oscillator;
#
# optimization Quiet(objectiveIntegrand = x1^2 + x2^2 + u^2, startTime = 0, finalTime = 20)
#   extends Oscillator(u(max=0.75));
# end Quiet;
# ```
#
# An equation is a `yield` of two sides. `extends` becomes inheritance, and a modification declares the name again.


# %%
class Oscillator(gt.Model):
    """Van der Pol's oscillator with an input."""

    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input()

    def equations(self):
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1


class Quiet(Oscillator, gt.Optimization):
    """Bring the oscillator to rest with little input."""

    u = gt.input(max=0.75)
    final_time = 20.0

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)


quiet = gt.solve(Quiet(), gt.Mesh(50, points=3))
print(f"{quiet.status.value} after {quiet.iterations} iterations, cost {quiet.objective:.9f}")

# %% [markdown]
# Many Optimica examples use a mesh of 50 elements with 3 Radau points. On the same mesh every solver must reach the
# same digits; `docs/conformance.md` has more such comparisons.

# %%
assert abs(quiet.objective - 3.176195803) < 1e-6 * 3.176195803

# %% [markdown]
# The usual device of a `cost` state with `objective = cost(finalTime)` works too, and gives the same optimum.


# %%
class QuietMayer(Quiet):
    """The cost as a state."""

    cost = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield der(self.cost) == self.x1**2 + self.x2**2 + self.u**2

    def objective(self):
        return self.cost.at(self.final_time)


mayer = gt.solve(QuietMayer(), gt.Mesh(50, points=3))
assert abs(mayer.objective - quiet.objective) < 1e-7 * quiet.objective

# %% [markdown]
# ## 2 Free final time
#
# ```modelica
# optimization Fast(objective = finalTime, startTime = 0, finalTime(free=true, initialGuess=2, min=0.2))
#   extends Oscillator(u(min=-1, max=1));
# constraint
#   x1(finalTime) = 0;
#   x2(finalTime) = 0;
# end Fast;
# ```


# %%
class Fast(Oscillator, gt.Optimization):
    """Reach the origin in minimum time."""

    u = gt.input(min=-1.0, max=1.0)
    final_time = gt.free(guess=2.0, min=0.2)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x1.at(self.final_time) == 0
        yield self.x2.at(self.final_time) == 0


fast = gt.solve(Fast(), gt.Mesh(50, points=3))
print(f"minimum time {fast.final_time:.9f} s")
assert abs(fast.final_time - 2.281159071) < 1e-6 * fast.final_time

# %% [markdown]
# A result is one object with units, whose values are read by name as from a result file: `fast.trajectory["x1"]`. It
# can also serve as the guess of the next solve (`guess=fast`), as `init_traj` did. Section 3 explains the peaks of u at
# the switch.

# %%
figure = Figure(figsize=(10, 3.4), layout="constrained")
for axes, solution, title in zip(figure.subplots(1, 2), (quiet, fast), ("quiet", "fast"), strict=True):
    fine = solution.sample(np.linspace(0.0, 1.0, 801))
    for name, colour in (("x1", "#0072b2"), ("x2", "#009e73"), ("u", "#d55e00")):
        axes.plot(fine.time, fine[name], color=colour, label=name)
    axes.set(title=title, xlabel="time [s]", ylabel="x1, x2, u [1]")
    axes.grid(alpha=0.3)
    axes.legend()
figure

# %% [markdown]
# ## 3 Constraints along the path
#
# ```modelica
# constraint
#   u^4 <= 0.1 + x1^2*x2^2;
# ```
#
# A constraint without `.at(...)` applies over the whole motion.


# %%
class Narrow(Quiet):
    """A bound on u that depends on the state."""

    u = gt.input()

    def constraints(self):
        yield self.u**4 <= 0.1 + self.x1**2 * self.x2**2


narrow = gt.solve(Narrow(), gt.Mesh(50, points=3))
print(f"cost {narrow.objective:.9f}")
assert abs(narrow.objective - 5.273481331) < 1e-6 * narrow.objective

# %% [markdown]
# The constraint holds at the collocation points only, a limitation that Optimica shares but does not report. Between
# the points a polynomial control may violate it. `resimulate` feeds the control into an integrator with error control,
# and reports the violation.

# %%
check = gt.resimulate(narrow)
print(f"violation between the points: {check.violation:.1e} of '{check.violated}'")
print(f"cost of the integrated motion minus cost of the optimum: {check.cost_error:+.1e}")
assert check.violation > 1e-4  # more than any residual of the optimiser
assert abs(check.cost_error) < 2e-3 * narrow.objective

# %% [markdown]
# ## 4 Constants from measurements
#
# In Optimica this is a `free` parameter and a sum of squares over the measured times, written out one by one:
#
# ```modelica
# optimization Fit(objective = sum((m.x2(t[i]) - y[i])^2 for i in 1:N), startTime = 0, finalTime = 8)
#   Damped m(mu(free=true, initialGuess=0.5, min=0));
#   parameter Real t[N] = {...};  parameter Real y[N] = {...};
# end Fit;
# ```
#
# The data here are **synthetic**: the oscillator with $\mu = 1.3$ and no input, integrated by SciPy, with normal noise
# of standard deviation 0.02 (seed 5).

# %%
TRUE_MU, NOISE = 1.3, 0.02
times = np.linspace(0.0, 8.0, 41)
truth = solve_ivp(
    lambda t, x: [TRUE_MU * (1 - x[1] ** 2) * x[0] - x[1], x[0]],
    (0.0, 8.0), [0.0, 1.0], "DOP853", t_eval=times, rtol=1e-11, atol=1e-11,
)  # fmt: skip
measured = truth.y[1] + NOISE * np.random.default_rng(5).standard_normal(len(times))


class Damped(gt.Model):
    """The oscillator without input; its damping mu is a parameter."""

    mu = gt.parameter(1.0, unit="1")
    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)

    def equations(self):
        yield der(self.x1) == self.mu * (1 - self.x2**2) * self.x1 - self.x2
        yield der(self.x2) == self.x1


class Fit(Damped, gt.Optimization):
    """Which mu explains the measurements best?"""

    mu = gt.free(0.5, min=0.0)
    final_time = 8.0

    def objective(self):
        return gt.misfit(self.x2, times, measured, sigma=NOISE)


fit = gt.solve(Fit(), gt.Mesh(40, points=3))
found = gt.estimate(fit)
low, high = found.interval("mu", 0.99)
print(found)
print(f"99 %: {low:.4f} to {high:.4f}, true {TRUE_MU}")

# %% [markdown]
# The measured times need not coincide with the mesh. With `sigma`, the covariance follows from the stated noise. The
# true value must lie in the confidence interval, and the residuals must look like the noise. The cross-check replaces
# the collocation by SciPy's integrator, and searches for the best constant directly.

# %%
figure = Figure(figsize=(6.5, 3.4), layout="constrained")
axes = figure.subplots()
fine = fit.sample(np.linspace(0.0, 1.0, 801))
axes.plot(fine.time, fine["x2"], color="#d55e00", linewidth=2.2, label=f"x2 with mu = {found.values[0]:.3f}")
axes.plot(times, measured, "o", color="black", markersize=3, label="synthetic measurements")
axes.set(xlabel="time [s]", ylabel="x2 [1]", title="fitted oscillator and measurements")
axes.grid(alpha=0.3)
axes.legend()
figure


# %%
def squares(mu):
    """Sum of squared residuals for a constant mu, with SciPy's integrator."""
    run = solve_ivp(
        lambda t, x: [mu * (1 - x[1] ** 2) * x[0] - x[1], x[0]],
        (0.0, 8.0), [0.0, 1.0], "DOP853", t_eval=times, rtol=1e-11, atol=1e-11,
    )  # fmt: skip
    return np.sum((run.y[1] - measured) ** 2)


step = 1e-3  # a parabola through three points has its vertex at the best constant
left, middle, right = (squares(found.values[0] + d) for d in (-step, 0.0, step))
best = found.values[0] + step * (left - right) / (2 * (left - 2 * middle + right))
print(f"collocation {found.values[0]:.6f}, integrator {best:.6f}")

assert low < TRUE_MU < high
assert abs(best - found.values[0]) < 0.1 * found.std[0]
assert 0.6 < np.sqrt(middle / len(times)) / NOISE < 1.4

# %% [markdown]
# ## 5 The text itself
#
# A `.mop` file need not be rewritten: `gt.modelica.load` returns the class, and on the command line `gtmodel solve
# van_der_pol.mop:Quiet` solves it. The next cell loads the oscillator of the shipped file as a component; results keep
# the names of the text.

# %%
shipped = gt.shipped("models/van_der_pol.mop")
for name, item in gt.modelica.listing(shipped).items():
    print(f"{name:28} line {item['line']:>3}  {item['description']}")

QuietText = gt.modelica.load(f"{shipped}:QuietComponent")
read = gt.solve(QuietText(), gt.Mesh(50, points=3))
print(f"cost {read.objective:.9f}, sys.x1 at the end {read.trajectory['sys.x1'][-1]:.2e}")
assert read.objective == quiet.objective  # bit for bit

# %% [markdown]
# To leave the text behind, print the class in Python (`gtmodel explain van_der_pol.mop:Fast --python`). It states the
# same problem.

# %%
print(gt.modelica.python_of(f"{shipped}:Fast"))

# %% [markdown]
# ## 6 What is different
#
# - **No compile step to call.** The class is the model; `gt.solve(P())` flattens it, chooses states and eliminates
# variables. `gt.SolverOptions(formulation="dae")` keeps all variables, as Optimica did; the optimum is the same.
# - **Changing a parameter** takes an argument, `Quiet(final_time=10.0)`, if it was declared as a parameter.
# `gt.transcribe(...)` solves again and again without rebuilding.
# - **A model with errors** is refused with the line of the class, not with a column of a matrix.

# %%
kept = gt.solve(Quiet(), gt.Mesh(50, points=3), solver=gt.SolverOptions(formulation="dae"))
assert abs(kept.objective - quiet.objective) < 1e-7 * quiet.objective


class Forgotten(Quiet):
    """One equation too few."""

    y = gt.variable()

    def objective(self):
        return gt.integral(self.x1**2 + self.y**2)


try:
    gt.solve(Forgotten(), gt.Mesh(50, points=3))
    message = ""
except gt.ModelError as error:
    message = str(error)
print(message)
assert "y" in message and "Forgotten" in message

# %% [markdown]
# ## Answer
#
# Files run as they are. In Python the translation goes class by class and line by line: `optimization` becomes a class
# that inherits from the model and `gt.Optimization`, attributes keep their names, `finalTime(free=true)` becomes
# `gt.free`, `x(t)` becomes `x.at(t)`, and a sum of squares becomes `gt.misfit`. The problem is the same: on the same
# mesh the optima agree with the known digits, and an independent integrator finds the same constant. gtmodel adds
# checks after the solve, covariances, and error messages with line numbers.
