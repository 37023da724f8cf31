"""Making demonstrations and rendering them."""
