// The supported classes of Modelica.Mechanics.MultiBody: parameters and variables, written independently of it.
// __mechanics("part.shaft.phi") is a quantity of the part of gt.mechanics that replaces the component; parts.py
// maps components to parts, and assembly.py connects them.
within Modelica.Mechanics;
package MultiBody
  model World "the frame of the world, and gravity"
    parameter Types.GravityTypes gravityType = Types.GravityTypes.UniformGravity;
    parameter Real g(unit = "m/s2") = Types.standardGravity;
    parameter Real n[3](each unit = "1") = {0, -1, 0};
    parameter Real defaultWidthFraction = 20;
    Interfaces.Frame_b frame_b;
  end World;

  package Types
    constant Real standardGravity = 9.81;
    type Axis = Real[3](each unit = "1");
    type Color = Integer[3];
    type RotationSequence = Integer[3];
    type GravityTypes = enumeration(NoGravity, UniformGravity, PointGravity);
    type RotationTypes = enumeration(RotationAxis, TwoAxesVectors, PlanarRotationSequence);
    type ResolveInFrameA = enumeration(world, frame_a, frame_resolve);
    type ResolveInFrameB = enumeration(world, frame_b, frame_resolve);
  end Types;

  package Frames
    record Orientation
      Real T[3, 3](each unit = "1") "takes vectors of the world to this frame";
      Real w[3](each unit = "rad/s") "angular velocity, in this frame";
    end Orientation;
  end Frames;

  package Interfaces
    connector Frame
      Real r_0[3](each unit = "m");
      Frames.Orientation R;
      flow Real f[3](each unit = "N");
      flow Real t[3](each unit = "N.m");
    end Frame;
    connector Frame_a = Frame;
    connector Frame_b = Frame;
    partial model PartialTwoFrames
      Frame_a frame_a;
      Frame_b frame_b;
    end PartialTwoFrames;
  end Interfaces;

  package Joints
    model Revolute "turns about n"
      extends Interfaces.PartialTwoFrames;
      parameter Boolean useAxisFlange = false;
      parameter Real n[3](each unit = "1") = {0, 0, 1};
      parameter StateSelect stateSelect = StateSelect.prefer;
      Modelica.Mechanics.Rotational.Interfaces.Flange_a axis if useAxisFlange;
      Modelica.Mechanics.Rotational.Interfaces.Flange_b support if useAxisFlange;
      Real phi(unit = "rad", start = 0, final stateSelect = stateSelect) "angle from frame_a to frame_b";
      Real w(unit = "rad/s", start = 0, stateSelect = stateSelect);
      Real a(unit = "rad/s2");
      Real tau(unit = "N.m") "torque of the drive on frame_b, about n";
      Real angle(unit = "rad");
    equation
      phi = __mechanics("part.shaft.phi");
      w = der(phi);
      a = der(w);
      angle = phi;
      if useAxisFlange then
        tau = __mechanics("drive.torque");
        axis.phi = phi;
        axis.tau = tau;
        support.phi = 0;
      else
        tau = 0;
      end if;
    end Revolute;

    model Prismatic "slides along n"
      extends Interfaces.PartialTwoFrames;
      parameter Boolean useAxisFlange = false;
      parameter Real n[3](each unit = "1") = {1, 0, 0};
      parameter StateSelect stateSelect = StateSelect.prefer;
      Modelica.Mechanics.Translational.Interfaces.Flange_a axis if useAxisFlange;
      Modelica.Mechanics.Translational.Interfaces.Flange_b support if useAxisFlange;
      Real s(unit = "m", start = 0, final stateSelect = stateSelect) "distance from frame_a to frame_b";
      Real v(unit = "m/s", start = 0, final stateSelect = stateSelect);
      Real a(unit = "m/s2");
      Real f(unit = "N") "force of the drive on frame_b, along n";
    equation
      s = __mechanics("part.flange.s");
      v = der(s);
      a = der(v);
      if useAxisFlange then
        f = __mechanics("drive.force");
        axis.s = s;
        axis.f = f;
        support.s = 0;
      else
        f = 0;
      end if;
    end Prismatic;

    model Spherical "the origins of its frames meet"
      extends Interfaces.PartialTwoFrames;
    end Spherical;

    model RevolutePlanarLoopConstraint "a revolute joint that closes a loop in a plane"
      extends Interfaces.PartialTwoFrames;
      parameter Real n[3](each unit = "1") = {0, 0, 1};
    end RevolutePlanarLoopConstraint;

    model Universal "turns about n_a, then about n_b"
      extends Interfaces.PartialTwoFrames;
      parameter Real n_a[3](each unit = "1") = {1, 0, 0};
      parameter Real n_b[3](each unit = "1") = {0, 1, 0};
      parameter StateSelect stateSelect = StateSelect.prefer;
      Revolute revolute_a(n = n_a, stateSelect = stateSelect);
      Revolute revolute_b(n = n_b, stateSelect = stateSelect);
      Real phi_a(unit = "rad", start = 0);
      Real phi_b(unit = "rad", start = 0);
      Real w_a(unit = "rad/s", start = 0);
      Real w_b(unit = "rad/s", start = 0);
    equation
      phi_a = revolute_a.phi;
      phi_b = revolute_b.phi;
      w_a = revolute_a.w;
      w_b = revolute_b.w;
      connect(frame_a, revolute_a.frame_a);
      connect(revolute_a.frame_b, revolute_b.frame_a);
      connect(revolute_b.frame_b, frame_b);
    end Universal;
  end Joints;

  package Parts
    model Fixed "a frame at r in the world"
      Interfaces.Frame_b frame_b;
      parameter Real r[3](each unit = "m") = {0, 0, 0};
    end Fixed;

    model FixedTranslation "frame_b at r in frame_a"
      extends Interfaces.PartialTwoFrames;
      parameter Real r[3](each unit = "m", start = {0, 0, 0});
    end FixedTranslation;

    model FixedRotation "frame_b at r in frame_a, and turned"
      extends Interfaces.PartialTwoFrames;
      parameter Real r[3](each unit = "m") = {0, 0, 0};
      parameter Types.RotationTypes rotationType = Types.RotationTypes.RotationAxis;
      parameter Real n[3] = {1, 0, 0};
      parameter Real angle = 0 "degrees";
      parameter Real n_x[3] = {1, 0, 0};
      parameter Real n_y[3] = {0, 1, 0};
      parameter Integer sequence[3] = {1, 2, 3};
      parameter Real angles[3] = {0, 0, 0} "degrees";
    end FixedRotation;

    model Body "a rigid body"
      Interfaces.Frame_a frame_a;
      parameter Real r_CM[3](each unit = "m", start = {0, 0, 0});
      parameter Real m(unit = "kg", min = 0, start = 1);
      parameter Real I_11(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_22(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_33(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_21(unit = "kg.m2") = 0;
      parameter Real I_31(unit = "kg.m2") = 0;
      parameter Real I_32(unit = "kg.m2") = 0;
      parameter Boolean angles_fixed = false;
      parameter Real angles_start[3](each unit = "rad") = {0, 0, 0};
      parameter Integer sequence_start[3] = {1, 2, 3};
      parameter Boolean w_0_fixed = false;
      parameter Real w_0_start[3](each unit = "rad/s") = {0, 0, 0};
      parameter Boolean enforceStates = false;
      Real r_0[3](each unit = "m");
      Real v_0[3](each unit = "m/s");
      Real a_0[3](each unit = "m/s2");
      Real w_a[3](each unit = "rad/s") "in frame_a";
      Real z_a[3](each unit = "rad/s2") "in frame_a";
    equation
      r_0 = __mechanics("part.frame.r", 3);
      v_0 = der(r_0);
      a_0 = der(v_0);
      w_a = frame_a.R.w;
      z_a = der(w_a);
    end Body;

    partial model TwoFrameBody
      extends Interfaces.PartialTwoFrames;
      parameter Real r[3](each unit = "m", start = {0, 0, 0});
      parameter Boolean angles_fixed = false;
      parameter Real angles_start[3](each unit = "rad") = {0, 0, 0};
      parameter Integer sequence_start[3] = {1, 2, 3};
      parameter Boolean w_0_fixed = false;
      parameter Real w_0_start[3](each unit = "rad/s") = {0, 0, 0};
      parameter Boolean enforceStates = false;
      Real r_0[3](each unit = "m");
      Real v_0[3](each unit = "m/s");
      Real a_0[3](each unit = "m/s2");
      FixedTranslation frameTranslation(r = r);
      Body body(angles_fixed = angles_fixed, angles_start = angles_start, sequence_start = sequence_start,
                w_0_fixed = w_0_fixed, w_0_start = w_0_start, enforceStates = enforceStates);
    equation
      r_0 = body.r_0;
      v_0 = body.v_0;
      a_0 = body.a_0;
      connect(frame_a, frameTranslation.frame_a);
      connect(frame_b, frameTranslation.frame_b);
      connect(frame_a, body.frame_a);
    end TwoFrameBody;

    model BodyShape "a rigid body with two frames"
      extends TwoFrameBody(body(r_CM = r_CM, m = m, I_11 = I_11, I_22 = I_22, I_33 = I_33, I_21 = I_21, I_31 = I_31,
                                I_32 = I_32));
      parameter Real r_CM[3](each unit = "m", start = {0, 0, 0});
      parameter Real m(unit = "kg", min = 0, start = 1);
      parameter Real I_11(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_22(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_33(unit = "kg.m2", min = 0) = 0.001;
      parameter Real I_21(unit = "kg.m2") = 0;
      parameter Real I_31(unit = "kg.m2") = 0;
      parameter Real I_32(unit = "kg.m2") = 0;
    end BodyShape;

    partial model Solid "a body of one density, long along r"
      extends TwoFrameBody(r(start = {0.1, 0, 0}),
                           body(r_CM = r_CM, m = m, I_11 = I[1, 1], I_22 = I[2, 2], I_33 = I[3, 3], I_21 = I[2, 1],
                                I_31 = I[3, 1], I_32 = I[3, 2]));
      parameter Real r_shape[3](each unit = "m") = {0, 0, 0};
      parameter Real lengthDirection[3] = r - r_shape;
      parameter Real length(unit = "m") = sqrt((r - r_shape)*(r - r_shape));
      parameter Real density(unit = "kg/m3") = 7700;
      final parameter Real m(unit = "kg") = outside[1] - inside[1];
      final parameter Real r_CM[3](each unit = "m") =
        r_shape + lengthDirection/sqrt(lengthDirection*lengthDirection)*length/2;
      final parameter Real I[3, 3](each unit = "kg.m2") = moments[1]*outerProduct(e_x, e_x)
        + moments[2]*outerProduct(e_y, e_y) + moments[3]*outerProduct(e_z, e_z);
      outer World world;
    protected
      parameter Real outside[4] "mass and principal moments of the body without its hole";
      parameter Real inside[4] "and of what the hole takes away";
      parameter Real side[3] "a direction across";
      final parameter Real moments[3] = outside[2:4] - inside[2:4];
      final parameter Real e_x[3] = r/sqrt(r*r);
      final parameter Real across[3] = cross(e_x, side);
      final parameter Real other[3] = if abs(e_x[1]) > 1e-6 then {0, 1, 0} else {1, 0, 0};
      final parameter Real normal[3] = if across*across > 1e-6 then across else cross(e_x, other);
      final parameter Real e_z[3] = normal/sqrt(normal*normal);
      final parameter Real e_y[3] = cross(e_z, e_x);
    end Solid;

    model BodyBox "a box"
      extends Solid(final side = widthDirection,
        final outside = density*length*width*height*{1, (width^2 + height^2)/12, (length^2 + height^2)/12,
                                                     (length^2 + width^2)/12},
        final inside = density*length*innerWidth*innerHeight*{1, (innerWidth^2 + innerHeight^2)/12,
          (length^2 + innerHeight^2)/12, (length^2 + innerWidth^2)/12});
      parameter Real widthDirection[3] = {0, 1, 0};
      parameter Real width(unit = "m") = length/world.defaultWidthFraction;
      parameter Real height(unit = "m") = width;
      parameter Real innerWidth(unit = "m") = 0;
      parameter Real innerHeight(unit = "m") = innerWidth;
    end BodyBox;

    model BodyCylinder "a cylinder"
      extends Solid(final side = {0, 1, 0},
        final outside = density*pi*length*diameter^2/4*{1, diameter^2/8, (length^2 + 3*diameter^2/4)/12,
                                                        (length^2 + 3*diameter^2/4)/12},
        final inside = density*pi*length*innerDiameter^2/4*{1, innerDiameter^2/8,
          (length^2 + 3*innerDiameter^2/4)/12, (length^2 + 3*innerDiameter^2/4)/12});
      parameter Real diameter(unit = "m") = length/world.defaultWidthFraction;
      parameter Real innerDiameter(unit = "m") = 0;
    protected
      constant Real pi = 3.141592653589793;
    end BodyCylinder;
  end Parts;

  package Forces
    partial model LineForce "between the origins of its frames, along their line"
      extends Interfaces.PartialTwoFrames;
      parameter Real c(unit = "N/m", min = 0) = 0;
      parameter Real d(unit = "N.s/m", min = 0) = 0;
      parameter Real s_unstretched(unit = "m") = 0;
      Real s(unit = "m") "distance of the frames";
      Real f(unit = "N") "draws them together";
    equation
      s = __mechanics("part.length");
      f = __mechanics("part.pull");
    end LineForce;
    model Spring
      extends LineForce(final d = 0, c(start = 1));
      parameter Real m(unit = "kg") = 0;
    end Spring;
    model Damper
      extends LineForce(final c = 0);
    end Damper;
    model SpringDamperParallel
      extends LineForce;
    end SpringDamperParallel;

    model WorldForce "a force on frame_b"
      Interfaces.Frame_b frame_b;
      Modelica.Blocks.Interfaces.RealInput force[3](each unit = "N");
      parameter Types.ResolveInFrameB resolveInFrame = Types.ResolveInFrameB.world;
    equation
      __mechanics("part.torque", 3) = zeros(3);
      __mechanics("part.force", 3) = if resolveInFrame == Types.ResolveInFrameB.world then force else
        transpose(frame_b.R.T)*force;
    end WorldForce;

    model WorldTorque "a torque on frame_b"
      Interfaces.Frame_b frame_b;
      Modelica.Blocks.Interfaces.RealInput torque[3](each unit = "N.m");
      parameter Types.ResolveInFrameB resolveInFrame = Types.ResolveInFrameB.world;
    equation
      __mechanics("part.force", 3) = zeros(3);
      __mechanics("part.torque", 3) = if resolveInFrame == Types.ResolveInFrameB.world then torque else
        transpose(frame_b.R.T)*torque;
    end WorldTorque;

    model WorldForceAndTorque "a force and a torque on frame_b"
      Interfaces.Frame_b frame_b;
      Modelica.Blocks.Interfaces.RealInput force[3](each unit = "N");
      Modelica.Blocks.Interfaces.RealInput torque[3](each unit = "N.m");
      parameter Types.ResolveInFrameB resolveInFrame = Types.ResolveInFrameB.world;
    equation
      __mechanics("part.force", 3) = if resolveInFrame == Types.ResolveInFrameB.world then force else
        transpose(frame_b.R.T)*force;
      __mechanics("part.torque", 3) = if resolveInFrame == Types.ResolveInFrameB.world then torque else
        transpose(frame_b.R.T)*torque;
    end WorldForceAndTorque;
  end Forces;

  package Sensors
    model AbsolutePosition "where frame_a is"
      Interfaces.Frame_a frame_a;
      Modelica.Blocks.Interfaces.RealOutput r[3](each unit = "m");
      parameter Types.ResolveInFrameA resolveInFrame = Types.ResolveInFrameA.frame_a;
    equation
      assert(resolveInFrame <> Types.ResolveInFrameA.frame_resolve, "a sensor with resolveInFrame = frame_resolve is not supported; use world or frame_a");
      r = if resolveInFrame == Types.ResolveInFrameA.world then frame_a.r_0 else frame_a.R.T*frame_a.r_0;
    end AbsolutePosition;

    model AbsoluteVelocity "how fast frame_a moves"
      Interfaces.Frame_a frame_a;
      Modelica.Blocks.Interfaces.RealOutput v[3](each unit = "m/s");
      parameter Types.ResolveInFrameA resolveInFrame = Types.ResolveInFrameA.frame_a;
    equation
      assert(resolveInFrame <> Types.ResolveInFrameA.frame_resolve, "a sensor with resolveInFrame = frame_resolve is not supported; use world or frame_a");
      v = if resolveInFrame == Types.ResolveInFrameA.world then der(frame_a.r_0) else frame_a.R.T*der(frame_a.r_0);
    end AbsoluteVelocity;

    model AbsoluteAngularVelocity "how fast frame_a turns"
      Interfaces.Frame_a frame_a;
      Modelica.Blocks.Interfaces.RealOutput w[3](each unit = "rad/s");
      parameter Types.ResolveInFrameA resolveInFrame = Types.ResolveInFrameA.frame_a;
    equation
      assert(resolveInFrame <> Types.ResolveInFrameA.frame_resolve, "a sensor with resolveInFrame = frame_resolve is not supported; use world or frame_a");
      w = if resolveInFrame == Types.ResolveInFrameA.world then transpose(frame_a.R.T)*frame_a.R.w else frame_a.R.w;
    end AbsoluteAngularVelocity;
  end Sensors;

  package Visualizers
    model FixedShape "a picture"
      Interfaces.Frame_a frame_a;
    end FixedShape;
    model FixedFrame "a picture"
      Interfaces.Frame_a frame_a;
    end FixedFrame;
  end Visualizers;
end MultiBody;
