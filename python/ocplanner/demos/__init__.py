"""Reading, writing, rendering and collecting demonstrations."""
