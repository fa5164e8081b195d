// Mechanisms of our own in words of Modelica.Mechanics.MultiBody, for the tests beside this file.
within;
model DoublePendulum "a box on a driven joint, a body on a free one"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81, animateGravity = false);
  Joints.Revolute r1(useAxisFlange = true, phi(start = -0.7, fixed = true), w(start = 0.3, fixed = true));
  Joints.Revolute r2(phi(start = -0.4, fixed = true), w(fixed = true), cylinderColor = {0, 0, 255});
  Parts.BodyBox b1(r = {0.5, 0, 0}, width = 0.06);
  Parts.BodyShape b2(r = {0.4, 0, 0}, r_CM = {0.2, 0.03, 0}, m = 2.0, I_33 = 0.02, animation = false);
  Modelica.Mechanics.Rotational.Components.Damper damper(d = 0.1);
  Modelica.Mechanics.Rotational.Sources.Torque motor(useSupport = true);
  Modelica.Blocks.Interfaces.RealInput u;
equation
  connect(world.frame_b, r1.frame_a);
  connect(r1.frame_b, b1.frame_a);
  connect(b1.frame_b, r2.frame_a);
  connect(r2.frame_b, b2.frame_a);
  connect(r1.support, damper.flange_a);
  connect(r1.axis, damper.flange_b);
  connect(motor.flange, r1.axis);
  connect(motor.support, r1.support);
  connect(u, motor.tau);
end DoublePendulum;

model Ramp "a slide on a ramp of 30 degrees, pushed and damped"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Parts.FixedRotation ramp(n = {0, 0, 1}, angle = 30, r = {0, 1, 0});
  Joints.Prismatic slide(n = {2, 0, 0}, useAxisFlange = true, s(start = 0.1, fixed = true), v(fixed = true));
  Parts.Body body(m = 3, r_CM = {0, 0.2, 0});
  Modelica.Mechanics.Translational.Sources.Force force;
  Modelica.Mechanics.Translational.Components.Damper damper(d = 4);
equation
  connect(world.frame_b, ramp.frame_a);
  connect(ramp.frame_b, slide.frame_a);
  connect(slide.frame_b, body.frame_a);
  connect(force.flange, slide.axis);
  connect(damper.flange_a, slide.support);
  connect(damper.flange_b, slide.axis);
  force.f = 20;
end Ramp;

model SphericalPendulum
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Spherical joint;
  Parts.BodyShape body(m = 2, r = {0.1, -0.4, 0.05}, r_CM = {0.1, -0.4, 0.05}, I_11 = 0.03, I_22 = 0.02, I_33 = 0.04,
                       I_21 = 0.002, w_0_fixed = true, w_0_start = {1, 2, -0.5}, angles_fixed = true,
                       angles_start = {0.3, -0.2, 0.5});
equation
  connect(world.frame_b, joint.frame_a);
  connect(joint.frame_b, body.frame_a);
end SphericalPendulum;

model FourBar "a planar loop"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Revolute crank(phi(start = 1.2, fixed = true), w(start = 2, fixed = true), stateSelect = StateSelect.always);
  Joints.Revolute coupler(phi(start = -0.7));
  Joints.Revolute rocker(phi(start = 1.5));
  Joints.RevolutePlanarLoopConstraint closure;
  Parts.BodyShape a(r = {0.3, 0, 0}, r_CM = {0.15, 0, 0}, m = 1, I_33 = 0.01);
  Parts.BodyShape b(r = {0.8, 0, 0}, r_CM = {0.4, 0.05, 0}, m = 2, I_33 = 0.1);
  Parts.BodyShape c(r = {0.6, 0, 0}, r_CM = {0.3, 0, 0}, m = 1.5, I_33 = 0.05);
  Parts.Fixed base(r = {0.7, 0, 0});
equation
  connect(world.frame_b, crank.frame_a);
  connect(crank.frame_b, a.frame_a);
  connect(a.frame_b, coupler.frame_a);
  connect(coupler.frame_b, b.frame_a);
  connect(base.frame_b, rocker.frame_a);
  connect(rocker.frame_b, c.frame_a);
  connect(b.frame_b, closure.frame_a);
  connect(c.frame_b, closure.frame_b);
end FourBar;

model SliderCrank "a loop in space"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Revolute crank(n = {1, 0, 0}, phi(start = 0.4, fixed = true), w(start = 3, fixed = true),
                        stateSelect = StateSelect.always);
  Parts.BodyShape arm(r = {0, 0.2, 0}, r_CM = {0, 0.1, 0}, m = 1, I_11 = 0.005);
  Joints.Revolute ball_1(n = {1, 0, 0});
  Joints.Revolute ball_2(n = {0, 1, 0});
  Joints.Revolute ball_3(n = {0, 0, 1});
  Parts.BodyShape rod(r = {0.7, 0, 0}, r_CM = {0.35, 0, 0}, m = 0.8, I_11 = 0.001, I_22 = 0.03, I_33 = 0.03);
  Parts.FixedTranslation rail(r = {0.3, -0.1, 0.1});
  Joints.Prismatic slider(n = {1, 0, 0}, s(start = 0.35));
  Parts.Body mass(m = 1.2, r_CM = {0, 0, 0});
  Joints.Universal fork(n_a = {0, 0, 1}, n_b = {0, 1, 0});
equation
  connect(world.frame_b, crank.frame_a);
  connect(crank.frame_b, arm.frame_a);
  connect(arm.frame_b, ball_1.frame_a);
  connect(ball_1.frame_b, ball_2.frame_a);
  connect(ball_2.frame_b, ball_3.frame_a);
  connect(ball_3.frame_b, rod.frame_a);
  connect(world.frame_b, rail.frame_a);
  connect(rail.frame_b, slider.frame_a);
  connect(slider.frame_b, mass.frame_a);
  connect(slider.frame_b, fork.frame_a);
  connect(fork.frame_b, rod.frame_b);
end SliderCrank;

model Solids "a hollow box and a pipe that fall"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Parts.BodyBox box(r = {0.5, 0, 0}, width = 0.1, height = 0.08, innerWidth = 0.05, innerHeight = 0.04);
  Parts.BodyCylinder pipe(r = {0, 0.4, 0}, diameter = 0.1, innerDiameter = 0.08, density = 2700);
end Solids;

model Held "an arm that a force across it and a torque hold"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Revolute joint;
  Parts.BodyShape arm(r = {0.5, 0, 0}, r_CM = {0.2, 0, 0}, m = 2);
  Forces.WorldForce force(resolveInFrame = Types.ResolveInFrameB.frame_b);
  Forces.WorldTorque torque;
  Sensors.AbsolutePosition tip(resolveInFrame = Types.ResolveInFrameA.world);
  Real push;
equation
  connect(world.frame_b, joint.frame_a);
  connect(joint.frame_b, arm.frame_a);
  connect(arm.frame_b, force.frame_b);
  connect(arm.frame_b, torque.frame_b);
  connect(arm.frame_b, tip.frame_a);
  force.force = {0, push, 0};
  torque.torque = {0, 0, 1.5};
end Held;

model Arm "a component with a frame of its own"
  Modelica.Mechanics.MultiBody.Interfaces.Frame_a mount;
  Modelica.Mechanics.MultiBody.Interfaces.Frame_b tip;
  Modelica.Mechanics.MultiBody.Joints.Revolute joint(useAxisFlange = true);
  Modelica.Mechanics.MultiBody.Parts.BodyShape link(r = {0.5, 0, 0}, r_CM = {0.25, 0, 0}, m = 1, I_33 = 0.02);
  Modelica.Mechanics.Rotational.Sources.Torque motor;
equation
  connect(mount, joint.frame_a);
  connect(joint.frame_b, link.frame_a);
  connect(link.frame_b, tip);
  connect(motor.flange, joint.axis);
end Arm;

optimization SwingUp(objectiveIntegrand = u^2, finalTime = 1.5)
  inner Modelica.Mechanics.MultiBody.World world(g = 9.81);
  Arm arm(joint(phi(start = -1.5707963267948966, fixed = true), w(fixed = true)));
  input Real u(min = -4, max = 4);
equation
  connect(world.frame_b, arm.mount);
  arm.motor.tau = u;
constraint
  arm.joint.phi(finalTime) = 1.5707963267948966;
  arm.joint.w(finalTime) = 0;
  arm.tip.r_0[1](finalTime) >= -0.1;
end SwingUp;

model Open "a body that falls by the library's own gravity"
  inner Modelica.Mechanics.MultiBody.World world;
  Modelica.Mechanics.MultiBody.Parts.Body body(m = 2, r_0(start = {1, 0, 0}, each fixed = true), v_0(each fixed = true));
end Open;

model Hung "a body on a spring and a damper, drawn down along their line"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Prismatic slide(n = {0, -1, 0}, s(start = 0.8, fixed = true), v(fixed = true));
  Parts.Body body(m = 2, r_CM = {0, 0, 0});
  Forces.SpringDamperParallel strut(c = 150, d = 3, s_unstretched = 0.5);
equation
  connect(world.frame_b, slide.frame_a);
  connect(slide.frame_b, body.frame_a);
  connect(world.frame_b, strut.frame_a);
  connect(strut.frame_b, body.frame_a);
end Hung;

model Redundant "a four-bar linkage whose joints all close the plane"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Revolute a(phi(start = 1.2, fixed = true)), b, c, d;
  Parts.BodyShape la(r = {0.3, 0, 0}, m = 1), lb(r = {0.8, 0, 0}, m = 1), lc(r = {0.6, 0, 0}, m = 1);
  Parts.Fixed base(r = {0.7, 0, 0});
equation
  connect(world.frame_b, a.frame_a);
  connect(a.frame_b, la.frame_a);
  connect(la.frame_b, b.frame_a);
  connect(b.frame_b, lb.frame_a);
  connect(lb.frame_b, c.frame_a);
  connect(c.frame_b, lc.frame_b);
  connect(lc.frame_a, d.frame_b);
  connect(d.frame_a, base.frame_b);
end Redundant;

model Cut "three links in an array, and the force in the first joint"
  import Modelica.Mechanics.MultiBody.*;
  inner World world(g = 9.81);
  Joints.Revolute joint[3](phi(each fixed = true), w(each fixed = true));
  Parts.BodyShape link[3](each r = {0, -0.3, 0}, each r_CM = {0, -0.15, 0}, m = {1, 2, 3});
  Real below = link[2].frame_a.f[2] "bears the links from the second on";
  Real by_joint = joint[2].frame_b.f[2];
equation
  connect(world.frame_b, joint[1].frame_a);
  connect(joint.frame_b, link.frame_a);
  for i in 1:2 loop
    connect(link[i].frame_b, joint[i + 1].frame_a);
  end for;
end Cut;
