"""Benchmarks of the whole skin, not installed; nothing in the package imports them."""
