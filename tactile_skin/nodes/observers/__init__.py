"""Nodes that watch the others, and hold none of them up."""
