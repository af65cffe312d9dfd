"""Which services there are, and what they count."""
