"""Modelica.Mechanics.MultiBody on gt.mechanics: joints, bodies and forces become parts of gt.mechanics."""
