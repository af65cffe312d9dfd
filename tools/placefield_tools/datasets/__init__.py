"""The public benchmarks: where they are, how they lie on the disk, and how to run them here."""
