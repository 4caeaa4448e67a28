"""Occupancy grids: wall surfaces and rooms from what a robot knows of a floor, cell by cell."""
