"""Recording matches into files (JSON lines, CSV, MCAP or Rerun), and reading the first two."""
