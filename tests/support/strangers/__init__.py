"""Boards as strangers have them: their sketches, their links, their readings."""
