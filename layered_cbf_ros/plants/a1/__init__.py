"""A real A1: its packets, the link to it, protections, and the driver's states."""
