"""Policies: BC and BC-RNN with a Gaussian mixture head, with or without the plan as a hint, and BCQ."""
