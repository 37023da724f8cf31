"""Hints and rewards made from plans, for data sets and live."""
