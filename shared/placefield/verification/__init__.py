"""Proof by geometry: whether two images can be views of one scene, from their local features."""
