"""Ground floor of all rooms: errors, settings and units, files, PETSc options."""
