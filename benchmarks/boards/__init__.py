"""Boards as they are: firmware, converters, text, another maker's insole."""
