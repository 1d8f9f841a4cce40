"""Hands that make gestures, and events that are none."""
