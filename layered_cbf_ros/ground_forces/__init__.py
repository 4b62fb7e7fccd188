"""The middle layer: ground reaction forces by MPC on a single rigid body (paper III-E)."""
