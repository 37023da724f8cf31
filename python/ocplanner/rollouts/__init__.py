"""Episodes dealt out to workers, and what their rates are worth."""
