"""Machines: each scene is a short file that puts the parts together."""
