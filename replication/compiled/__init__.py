"""Fast twins of plain code, each tested equal to it."""
