"""Matches off the bus into a file: JSON lines, CSV, MCAP or Rerun; and back from the first two."""
