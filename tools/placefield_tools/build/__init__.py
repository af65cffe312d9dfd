"""Sources of frames to a map."""
