"""The experiments of the AMS paper, on a drive of one's own."""
