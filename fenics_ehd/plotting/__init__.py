"""Pictures, imported only if one is drawn."""
