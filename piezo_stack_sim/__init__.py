"""A virtual piezoelectric stack actuator, and a diagnosis of what a real one does differently."""
