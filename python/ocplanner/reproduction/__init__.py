"""The paper's tables and figures, and our experiments."""
