"""Damaged boards through the complete chain, and what was missed."""
