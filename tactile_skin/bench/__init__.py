"""Measurements: what the package promises in figures, by functions that return plain dicts."""
