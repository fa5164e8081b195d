// Basic components of Rotational and Translational, which drive joints of MultiBody: used if no Modelica library is
// given, and written independently of it.
within Modelica.Mechanics;
package Rotational
  package Interfaces
    connector Flange_a
      Real phi(unit = "rad");
      flow Real tau(unit = "N.m");
    end Flange_a;
    connector Flange_b = Flange_a;
  end Interfaces;
  package Sources
    model Torque "a torque on flange"
      parameter Boolean useSupport = false;
      Modelica.Blocks.Interfaces.RealInput tau(unit = "N.m");
      Interfaces.Flange_b flange;
      Interfaces.Flange_a support if useSupport;
    equation
      flange.tau = -tau;
      if useSupport then
        support.tau = tau;
      end if;
    end Torque;
    model ConstantTorque "a torque on flange"
      parameter Real tau_constant(unit = "N.m");
      Interfaces.Flange_b flange;
    equation
      flange.tau = -tau_constant;
    end ConstantTorque;
  end Sources;
  package Components
    model Fixed
      parameter Real phi0(unit = "rad") = 0;
      Interfaces.Flange_b flange;
    equation
      flange.phi = phi0;
    end Fixed;
    model Inertia
      parameter Real J(unit = "kg.m2", min = 0, start = 1);
      parameter StateSelect stateSelect = StateSelect.default;
      Interfaces.Flange_a flange_a;
      Interfaces.Flange_b flange_b;
      Real phi(unit = "rad", stateSelect = stateSelect);
      Real w(unit = "rad/s", stateSelect = stateSelect);
      Real a(unit = "rad/s2");
    equation
      phi = flange_a.phi;
      phi = flange_b.phi;
      w = der(phi);
      a = der(w);
      J*a = flange_a.tau + flange_b.tau;
    end Inertia;
    partial model Between
      Interfaces.Flange_a flange_a;
      Interfaces.Flange_b flange_b;
      Real phi_rel(unit = "rad");
      Real tau(unit = "N.m");
    equation
      phi_rel = flange_b.phi - flange_a.phi;
      flange_b.tau = tau;
      flange_a.tau = -tau;
    end Between;
    model Spring
      extends Between;
      parameter Real c(unit = "N.m/rad", min = 0, start = 1e5);
      parameter Real phi_rel0(unit = "rad") = 0;
    equation
      tau = c*(phi_rel - phi_rel0);
    end Spring;
    model Damper
      extends Between;
      parameter Real d(unit = "N.m.s/rad", min = 0, start = 0);
      Real w_rel(unit = "rad/s");
    equation
      w_rel = der(phi_rel);
      tau = d*w_rel;
    end Damper;
    model SpringDamper
      extends Between;
      parameter Real c(unit = "N.m/rad", min = 0, start = 1e5);
      parameter Real d(unit = "N.m.s/rad", min = 0, start = 0);
      parameter Real phi_rel0(unit = "rad") = 0;
      Real w_rel(unit = "rad/s");
    equation
      w_rel = der(phi_rel);
      tau = c*(phi_rel - phi_rel0) + d*w_rel;
    end SpringDamper;
    model IdealGear
      parameter Real ratio(start = 1);
      Interfaces.Flange_a flange_a;
      Interfaces.Flange_b flange_b;
    equation
      flange_a.phi = ratio*flange_b.phi;
      0 = ratio*flange_a.tau + flange_b.tau;
    end IdealGear;
  end Components;
end Rotational;

package Translational
  package Interfaces
    connector Flange_a
      Real s(unit = "m");
      flow Real f(unit = "N");
    end Flange_a;
    connector Flange_b = Flange_a;
  end Interfaces;
  package Sources
    model Force "a force on flange"
      parameter Boolean useSupport = false;
      Modelica.Blocks.Interfaces.RealInput f(unit = "N");
      Interfaces.Flange_b flange;
      Interfaces.Flange_a support if useSupport;
    equation
      flange.f = -f;
      if useSupport then
        support.f = f;
      end if;
    end Force;
    model ConstantForce "a force on flange"
      parameter Real f_constant(unit = "N");
      Interfaces.Flange_b flange;
    equation
      flange.f = -f_constant;
    end ConstantForce;
  end Sources;
  package Components
    model Fixed
      parameter Real s0(unit = "m") = 0;
      Interfaces.Flange_b flange;
    equation
      flange.s = s0;
    end Fixed;
    partial model Between
      Interfaces.Flange_a flange_a;
      Interfaces.Flange_b flange_b;
      Real s_rel(unit = "m");
      Real f(unit = "N");
    equation
      s_rel = flange_b.s - flange_a.s;
      flange_b.f = f;
      flange_a.f = -f;
    end Between;
    model Spring
      extends Between;
      parameter Real c(unit = "N/m", min = 0, start = 1);
      parameter Real s_rel0(unit = "m") = 0;
    equation
      f = c*(s_rel - s_rel0);
    end Spring;
    model Damper
      extends Between;
      parameter Real d(unit = "N.s/m", min = 0, start = 0);
      Real v_rel(unit = "m/s");
    equation
      v_rel = der(s_rel);
      f = d*v_rel;
    end Damper;
    model SpringDamper
      extends Between;
      parameter Real c(unit = "N/m", min = 0, start = 1);
      parameter Real d(unit = "N.s/m", min = 0, start = 1);
      parameter Real s_rel0(unit = "m") = 0;
      Real v_rel(unit = "m/s");
    equation
      v_rel = der(s_rel);
      f = c*(s_rel - s_rel0) + d*v_rel;
    end SpringDamper;
    model Mass
      parameter Real m(unit = "kg", min = 0, start = 1);
      parameter StateSelect stateSelect = StateSelect.default;
      Interfaces.Flange_a flange_a;
      Interfaces.Flange_b flange_b;
      Real s(unit = "m", stateSelect = stateSelect);
      Real v(unit = "m/s", stateSelect = stateSelect);
      Real a(unit = "m/s2");
    equation
      s = flange_a.s;
      s = flange_b.s;
      v = der(s);
      a = der(v);
      m*a = flange_a.f + flange_b.f;
    end Mass;
  end Components;
end Translational;
