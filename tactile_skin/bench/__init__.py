"""Measurements: what each method costs and how far it errs, with production code only."""
