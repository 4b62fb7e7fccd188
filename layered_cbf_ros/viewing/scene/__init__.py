"""The 3D scene and the panels of the page, drawn by viser."""
