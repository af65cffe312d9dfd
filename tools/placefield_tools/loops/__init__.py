"""Finding the loops of one drive, and writing them to files."""
