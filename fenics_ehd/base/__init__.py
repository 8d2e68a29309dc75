"""Foundation of all other packages: errors, settings and units, files, PETSc options."""
