"""Whether this machine can run Placefield, and what to do where it cannot."""
