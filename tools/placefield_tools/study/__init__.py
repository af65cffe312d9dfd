"""The study: every method on the same frames, and an ablation of ours."""
