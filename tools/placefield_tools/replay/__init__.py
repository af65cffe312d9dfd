"""A source of frames onto the bus."""
