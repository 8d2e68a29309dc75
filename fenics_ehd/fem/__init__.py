"""Gmsh models and dolfinx: meshes, structures, stresses."""
