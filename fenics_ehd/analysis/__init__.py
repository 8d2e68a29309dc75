"""A run once more: replays, error budgets, sensitivities, multipliers."""
