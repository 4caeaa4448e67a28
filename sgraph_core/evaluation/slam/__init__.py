"""Whether rooms and walls make trajectory and map better: every method on the same drives."""
