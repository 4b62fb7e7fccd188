"""Safety-critical coordination of legged robots (see README.md)."""
