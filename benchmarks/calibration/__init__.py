"""What a skin learns of its board: rest, circuit, curve, creep."""
