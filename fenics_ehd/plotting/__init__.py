"""Pictures, imported only when one is asked for."""
