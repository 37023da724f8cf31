"""Episodes spread over workers, and confidence intervals of their success rates."""
