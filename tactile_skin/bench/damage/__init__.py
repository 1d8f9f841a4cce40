"""`tactile-skin bench faults`: damaged boards through the whole chain, and what was missed."""
