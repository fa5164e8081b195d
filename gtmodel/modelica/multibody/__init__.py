"""Modelica.Mechanics.MultiBody on gt.mechanics: its joints, bodies and forces as parts of ours."""
