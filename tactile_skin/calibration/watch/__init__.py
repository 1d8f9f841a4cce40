"""What a running skin watches for: cells, lines and readings that no sound skin has."""
