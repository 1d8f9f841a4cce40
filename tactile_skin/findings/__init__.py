"""What was found wrong, as a value (finding.py), and its words (words.py, words.csv)."""
