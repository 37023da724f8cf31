"""Policies learned by imitation, with or without the plan as a hint: BC and BC-RNN with a Gaussian mixture head."""
