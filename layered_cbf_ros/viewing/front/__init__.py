"""The page that people open: who may enter, who steers, the stick, and the way to the scene."""
