"""Networks by name: which there are, where they come from, and fetching them."""
