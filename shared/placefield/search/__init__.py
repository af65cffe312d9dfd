"""Nearest places, quickly: quantized descriptors, coarse search and re-ranking."""
