"""Credentials: an authority, a certificate for each role, and what each role may do."""
