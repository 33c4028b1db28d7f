"""Parameters of an actuator from recordings of it, or from its data sheet."""
