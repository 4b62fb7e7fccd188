"""Shows what is in a bag: as a table, as messages, as figures, as files for other tools."""
