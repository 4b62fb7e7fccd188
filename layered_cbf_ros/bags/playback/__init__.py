"""Playing a bag: what is sent when, and what a person sees and presses; without ROS."""
