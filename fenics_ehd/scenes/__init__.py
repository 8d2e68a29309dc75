"""Scenes: short files that each describe a machine by its parts."""
