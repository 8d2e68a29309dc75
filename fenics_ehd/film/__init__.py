"""The oil film of a bore: Reynolds equation with cavitation."""
