"""What is known of the world: obstacle tracks."""
