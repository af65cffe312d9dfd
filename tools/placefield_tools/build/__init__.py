"""Building a map from sources of frames."""
