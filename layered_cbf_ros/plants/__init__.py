"""What moves below the layers: a PyBullet world."""
