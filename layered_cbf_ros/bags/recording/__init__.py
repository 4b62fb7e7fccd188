"""What a recorder takes, and what it counts."""
