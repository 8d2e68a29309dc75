"""Parameter sweeps: one scene over the product of given values, one row for each run."""
