"""The public benchmarks: their addresses, their layout on disk, and how to run them here."""
