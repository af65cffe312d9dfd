"""The study: every method on the same frames, and what each part of ours is worth."""
