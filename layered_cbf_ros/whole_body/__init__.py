"""The bottom layer: joint torques by virtual constraints (paper III-F)."""
