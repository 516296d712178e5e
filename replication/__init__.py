"""A reproducible workbook of "A virtual sensor for backlash in robotic manipulators"."""
