"""Hints and rewards out of plans, for data sets and live."""
