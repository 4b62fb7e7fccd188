"""One thin file per executable; the only room that imports rclpy."""
