"""How far solvers and features are from the truth, and how fast."""
