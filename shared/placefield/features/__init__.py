"""Features: from images to descriptors."""
