"""All that is to be seen at one instant, from the live graph or from a bag."""
