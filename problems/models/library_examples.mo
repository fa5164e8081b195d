// Models of components of the Modelica Standard Library, which is read from a folder: MODELICAPATH=/path/to/library
package LibraryExamples
  model LowPass "a resistor and a capacitor, connected to a constant voltage at time 0"
    Modelica.Electrical.Analog.Sources.ConstantVoltage source(V = 10);
    Modelica.Electrical.Analog.Basic.Resistor resistor(R = 100);
    Modelica.Electrical.Analog.Basic.Capacitor capacitor(C = 1e-3, v(start = 0, fixed = true));
    Modelica.Electrical.Analog.Basic.Ground ground;
  equation
    connect(source.p, resistor.p);
    connect(resistor.n, capacitor.p);
    connect(capacitor.n, source.n);
    connect(source.n, ground.p);
    annotation(experiment(StopTime = 0.5));
  end LowPass;

  model Drive "a torque on two inertias with a spring and a damper between them"
    Modelica.Blocks.Sources.Constant command(k = 10);
    Modelica.Mechanics.Rotational.Sources.Torque motor;
    Modelica.Mechanics.Rotational.Components.Inertia rotor(J = 1, phi(start = 0, fixed = true),
                                                           w(start = 0, fixed = true));
    Modelica.Mechanics.Rotational.Components.SpringDamper shaft(c = 100, d = 1);
    Modelica.Mechanics.Rotational.Components.Inertia load(J = 2, phi(start = 0, fixed = true),
                                                          w(start = 0, fixed = true));
  equation
    connect(command.y, motor.tau);
    connect(motor.flange, rotor.flange_a);
    connect(rotor.flange_b, shaft.flange_a);
    connect(shaft.flange_b, load.flange_a);
    annotation(experiment(StopTime = 1));
  end Drive;

  model Oscillator "a mass on a spring and a damper, released from rest"
    Modelica.Mechanics.Translational.Components.Fixed wall(s0 = 0);
    Modelica.Mechanics.Translational.Components.SpringDamper spring(c = 50, d = 2, s_rel0 = 0);
    Modelica.Mechanics.Translational.Components.Mass mass(m = 2, s(start = 0.1, fixed = true),
                                                          v(start = 0, fixed = true));
  equation
    connect(wall.flange, spring.flange_a);
    connect(spring.flange_b, mass.flange_a);
    annotation(experiment(StopTime = 1));
  end Oscillator;

  model ControlLoop "a PI controller, and a second-order plant as a transfer function"
    Modelica.Blocks.Sources.Constant reference(k = 1);
    Modelica.Blocks.Math.Feedback error;
    Modelica.Blocks.Continuous.PI controller(k = 2, T = 0.5, initType = Modelica.Blocks.Types.Init.InitialState);
    Modelica.Blocks.Continuous.TransferFunction plant(b = {1}, a = {0.1, 1, 1},
                                                      initType = Modelica.Blocks.Types.Init.InitialState);
  equation
    connect(reference.y, error.u1);
    connect(error.y, controller.u);
    connect(controller.y, plant.u);
    connect(plant.y, error.u2);
    annotation(experiment(StopTime = 3));
  end ControlLoop;
end LibraryExamples;
