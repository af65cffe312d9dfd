"""Messages, keys and sessions: the only package that imports zenoh."""
