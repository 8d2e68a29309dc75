"""Planar floating frame, mechanism kinematics, journal coupling and time integration."""
