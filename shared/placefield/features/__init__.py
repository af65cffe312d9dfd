"""Image to descriptor."""
