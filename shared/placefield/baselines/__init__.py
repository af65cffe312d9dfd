"""What else there is, to compare with."""
