"""Maps from another host."""
