"""Analyses of runs: replays, error budgets, sensitivities, multipliers, and single bearings."""
