"""What every other room needs: errors, settings and units, files, PETSc options."""
