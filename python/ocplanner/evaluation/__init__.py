"""Rollouts, intervals and tables."""
