"""What each mechanism that doubts readings is worth."""
