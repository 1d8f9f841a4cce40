"""What was found wrong, as a value (finding.py), and all its words (words.py)."""
