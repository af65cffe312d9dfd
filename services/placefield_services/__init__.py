"""The processes: read, call the library, publish."""
