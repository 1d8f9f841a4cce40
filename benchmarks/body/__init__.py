"""Several skins as one body."""
