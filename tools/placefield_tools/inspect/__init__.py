"""What is in a map."""
