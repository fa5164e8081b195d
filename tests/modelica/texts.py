"""Problems with known optima as Optimica texts, written for these tests."""

QUIET = """
optimization Quiet(objectiveIntegrand = {integrand}, objective = {objective}, startTime = 0, finalTime = 20)
  parameter Real p = 1;
  Real x1(start = 0, fixed = true);
  Real x2(start = 1, fixed = true);
  Real cost(start = 0, fixed = true);
  input Real u(max = 0.75);
equation
  der(x1) = (1 - x2^2)*x1 - x2 + u;
  der(x2) = p*x1;
  der(cost) = exp(p)^2*(x1^2 + x2^2 + u^2);
end Quiet;
"""
WEIGHTED = QUIET.format(integrand="exp(p)^2*(x1^2 + x2^2 + u^2)", objective="0")
AS_STATE = QUIET.format(integrand="0", objective="cost(finalTime)")

DOUBLE = """
optimization Double(objectiveIntegrand = u^2, finalTime = 2.1)
  Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  Real difference;
  Real total = x + v;
  input Real u(min = -1, max = 1);
equation
  der(x) = v;
  der(v) = u;
  difference = x - v;
constraint
  x(finalTime) = 0;
  v(finalTime) = 0;
end Double;
"""
FINAL_FREE = """
optimization Shortest(objective = finalTime, finalTime(free = true))
  Real x(start = 1, fixed = true);
  Real v(fixed = true);
  input Real u(min = -1, max = 1);
equation
  der(x) = v;
  der(v) = u;
constraint
  x(finalTime) = 0;
  v(finalTime) = 0;
end Shortest;
"""
_FREE_END = "objective = finalTime, finalTime(free = true)"
_FREE_BEGIN = "objective = -startTime, startTime(free = true, initialGuess = -1), finalTime = 1"
START_FREE = FINAL_FREE.replace(_FREE_END, _FREE_BEGIN)
STATE_BOUND = """
optimization Valley(objectiveIntegrand = x1^2 + x2^2 + 0.005*u^2, finalTime = 1)
  Real x1(start = 0, fixed = true);
  Real x2(start = -1, fixed = true);
  input Real u(min = -20, max = 20);
equation
  der(x1) = x2;
  der(x2) = -x2 + u;
constraint
  8*(time - 0.5)^2 - 0.5 - x2 >= 0;
end Valley;
"""
FREE_START = """
optimization FreeStart(objectiveIntegrand = 100*x^2 + d^2, finalTime = 1)
  Real x(start = 1, fixed = true);
  Real u(start = 0);
  input Real d;
equation
  der(x) = -x + u;
  der(u) = d;
constraint
  d >= -0.1;
  d <= 0.1;
end FreeStart;
"""
TANK = """
package Tank
  model Stirred
    parameter Real F0 = 100/1000/60;
    parameter Real c0 = 1000;
    parameter Real T0 = 350;
    parameter Real V = 100;
    parameter Real k0 = 7.2e10/60;
    parameter Real E = 8750;
    parameter Real r = 0.219;
    parameter Real U = 915.6;
    parameter Real rho = 1000;
    parameter Real Cp = 239;
    parameter Real dH = -5e4;
    parameter Real c_start = 1000;
    parameter Real T_start = 350;
    Real c(start = c_start, fixed = true, nominal = c0);
    Real T(start = T_start, fixed = true, nominal = T0);
    input Real Tc;
  equation
    der(c) = F0*(c0 - c)/V - k0*c*exp(-E/T);
    der(T) = F0*(T0 - T)/V - dH/(rho*Cp)*k0*c*exp(-E/T) + 2*U/(r*rho*Cp)*(Tc - T);
  end Stirred;
  optimization Hold(objectiveIntegrand = 1e-4*((338.775766 - tank.c)^2 + (280.099198 - tank.T)^2 + (280 - Tc)^2),
                    finalTime = 150)
    Stirred tank(Tc = Tc, T(max = 350), c_start = 956.271065, T_start = 250.051971);
    input Real Tc(start = 280, min = 230, max = 370);
  end Hold;
  optimization HoldExtended = Hold;
end Tank;
"""
LINEAR = """
package Linear
  model System
    parameter Real A[:, :] = {{-1, 0.5}, {0, -2}};
    parameter Real B[size(A, 1)] = {1, 1};
    Real x[size(A, 1)](start = {1, 2}, each fixed = true);
    input Real u;
  equation
    der(x) = A*x + B*u;
  end System;
  optimization Forms(objectiveIntegrand = x*Q*x + R*u^2, objective = x[1](finalTime)^2 + x[2](finalTime)^2)
    extends System;
    parameter Real Q[2, 2] = {{1, 0.1}, {0.1, 2}};
    parameter Real R = 0.5;
  end Forms;
  optimization Written(objectiveIntegrand = x1*(x1 + 0.1*x2) + x2*(0.1*x1 + 2*x2) + 0.5*u^2,
                       objective = x1(finalTime)^2 + x2(finalTime)^2)
    Real x1(start = 1, fixed = true);
    Real x2(start = 2, fixed = true);
    input Real u;
  equation
    der(x1) = -x1 + 0.5*x2 + u;
    der(x2) = -2*x2 + u;
  end Written;
end Linear;
"""
FRICTION = """
optimization Friction(objective = finalTime, finalTime(free = true, initialGuess = 2))
  Real q(start = 0, fixed = true);
  Real w(start = 1, fixed = true);
  Real direction;
  input Real u(min = -2, max = 2);
equation
  der(q) = w;
  der(w) = u - direction;
  direction = noEvent(if w > 0 then 1 else -1);
constraint
  q(finalTime) = -1;
  w(finalTime) = 0;
end Friction;
"""
PENDULUM = """
model Pendulum
  parameter Real L = 1;
  parameter Real g = 9.81;
  Real x(start = 1, fixed = true);
  Real y(start = 0);
  Real vx;
  Real vy(start = 0, fixed = true);
  Real pull;
equation
  der(x) = vx;
  der(y) = vy;
  der(vx) = -pull*x;
  der(vy) = -pull*y - g;
  x^2 + y^2 = L^2;
  annotation(experiment(StopTime = 2));
end Pendulum;
"""
CRACKING = """
optimization Cracking(objective = sum((y1(t[i]) - m1[i])^2 + (y2(t[i]) - m2[i])^2 for i in 1:21), finalTime = 0.95)
  parameter Real t[21] = {0, 0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5,
    0.55, 0.65, 0.75, 0.85, 0.95};
  parameter Real m1[21] = {1, 0.8105, 0.6208, 0.5258, 0.4345, 0.3903, 0.3342, 0.3034, 0.2735, 0.2405, 0.2283, 0.2071,
    0.1669, 0.1530, 0.1339, 0.1265, 0.1200, 0.0990, 0.0870, 0.0770, 0.0690};
  parameter Real m2[21] = {0, 0.2, 0.2886, 0.3010, 0.3215, 0.3123, 0.2716, 0.2551, 0.2258, 0.1959, 0.1789, 0.1457,
    0.1198, 0.0909, 0.0719, 0.0561, 0.0460, 0.0280, 0.0190, 0.0140, 0.0100};
  parameter Real a(free = true, initialGuess = 5, min = 0);
  parameter Real b(free = true, initialGuess = 5, min = 0);
  parameter Real c(free = true, initialGuess = 1, min = 0);
  Real y1(start = 1, fixed = true);
  Real y2(start = 0, fixed = true);
equation
  der(y1) = -(a + c)*y1^2;
  der(y2) = a*y1^2 - b*y2;
end Cracking;
"""
# COPS 3.0: a population in eight stages, counted 21 times; rates of mortality and of growth
MARINE = """
optimization Marine(objective = sum(sum((y[j](i) - counted[i + 1, j])^2 for i in 0:20) for j in 1:8), finalTime = 20)
  parameter Real counted[21, 8] = {
    {20000, 17000, 10000, 15000, 12000, 9000, 7000, 3000},
    {12445, 15411, 13040, 13338, 13484, 8426, 6615, 4022},
    {7705, 13074, 14623, 11976, 12453, 9272, 6891, 5020},
    {4664, 8579, 12434, 12603, 11738, 9710, 6821, 5722},
    {2977, 7053, 11219, 11340, 13665, 8534, 6242, 5695},
    {1769, 5054, 10065, 11232, 12112, 9600, 6647, 7034},
    {943, 3907, 9473, 10334, 11115, 8826, 6842, 7348},
    {581, 2624, 7421, 10297, 12427, 8747, 7199, 7684},
    {355, 1744, 5369, 7748, 10057, 8698, 6542, 7410},
    {223, 1272, 4713, 6869, 9564, 8766, 6810, 6961},
    {137, 821, 3451, 6050, 8671, 8291, 6827, 7525},
    {87, 577, 2649, 5454, 8430, 7411, 6423, 8388},
    {49, 337, 2058, 4115, 7435, 7627, 6268, 7189},
    {32, 228, 1440, 3790, 6474, 6658, 5859, 7467},
    {17, 168, 1178, 3087, 6524, 5880, 5562, 7144},
    {11, 99, 919, 2596, 5360, 5762, 4480, 7256},
    {7, 65, 647, 1873, 4556, 5058, 4944, 7538},
    {4, 44, 509, 1571, 4009, 4527, 4233, 6649},
    {2, 27, 345, 1227, 3677, 4229, 3805, 6378},
    {1, 20, 231, 934, 3197, 3695, 3159, 6454},
    {1, 12, 198, 707, 2562, 3163, 3232, 5566}};
  parameter Real m[8](each free = true, each initialGuess = 0.3, each min = 0);
  parameter Real g[7](each free = true, each initialGuess = 0.3, each min = 0);
  Real y[8](start = counted[1, :], each fixed = true);
equation
  der(y) = cat(1, {0}, g).*cat(1, {0}, y[1:7]) - (m + cat(1, g, {0})).*y;
end Marine;
"""
