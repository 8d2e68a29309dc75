"""Gmsh models of the parts, shipped as package data."""
